// SPDX-License-Identifier: Apache-2.0
#define TOML_EXCEPTIONS 1
#include <toml++/toml.h>

#include <sstream>

#include "acquire/import/import_views.h"

namespace refield {

namespace fs = std::filesystem;

std::string plan_of(const ImportRequest& request, const std::vector<ImportedView>& views) {
  const auto file_text = [](const fs::path& path) {
    std::error_code error;
    const auto bytes = fs::file_size(path, error);
    return path.filename().string() + " " + (error ? "missing" : std::to_string(bytes));
  };
  const auto list_of = [&](const std::vector<fs::path>& paths) {
    toml::array list;
    for (const fs::path& path : paths) list.push_back(file_text(path));
    return list;
  };
  toml::array frames, exposures;
  for (std::size_t i = 0; i < views.size(); ++i)
    frames.push_back(toml::table{{"name", views[i].name},
                                 {"role", std::string(name_of(role_of(request, views[i].name, i)))},
                                 {"light", file_text(views[i].light)},
                                 {"photographs", list_of(views[i].bracket.paths)}});
  for (const Seconds exposure : request.exposures) exposures.push_back(exposure.count());
  const BracketCamera& camera = request.camera;
  const auto optional_text = [](const std::optional<double>& value) {
    return value ? std::to_string(*value) : "";
  };
  toml::table plan{
      {"format", "refield import"},
      {"version", 1},
      {"response", fs::is_regular_file(camera.response) ? file_text(camera.response) : camera.response},
      {"layout", camera.layout},
      {"black", optional_text(camera.black)},
      {"saturation", optional_text(camera.saturation)},
      {"full_scale_electrons", camera.full_scale_electrons},
      {"read_noise_electrons", camera.read_noise_electrons},
      {"exposures", exposures},
      {"lights_hold", request.light_content == LightContent::radiance ? "radiance" : "drive levels"},
      {"parameterisation", std::string(name_of(request.parameterisation))},
      {"half", request.precision == Precision::half},
      {"mask", request.mask ? file_text(*request.mask) : ""},
      {"ambient", list_of(request.ambient)},
      {"frame", frames}};
  std::ostringstream text;
  text << plan << "\n";
  return text.str();
}

}  // namespace refield
