// SPDX-License-Identifier: Apache-2.0
#include "cli/acquire/light_list.h"

#include <algorithm>

#include "cli/run_context.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/number_text.h"
#include "core/image/image_io.h"
#include "core/session/capture_session.h"

namespace refield::cli {

namespace fs = std::filesystem;

std::vector<CaptureLight> lights_of_files(const std::string& pattern) {
  std::vector<CaptureLight> lights;
  for (const GlobMatch& match : expand_glob(pattern)) {
    const std::string name = match.path.stem().string();
    const bool is_reference = role_of_light(name) == FrameRole::reference;
    const Image light = read_light_map(match.path, Parameterisation::monitor, run_context()).radiance;
    lights.push_back({name, is_reference ? FrameRole::reference : FrameRole::train,
                      std::string(kind_of_light(light)), match.path});
  }
  return lights;
}

Image uniform_light(int width, int height, const std::array<float, 3>& colour) {
  Image light(width, height, 3);
  for (std::size_t i = 0; i < light.values.size(); ++i) light.values[i] = colour[i % 3];
  return light;
}

std::filesystem::path add_primaries_and_white(std::vector<CaptureLight>& lights, int width, int height,
                                              float white, const fs::path& folder) {
  const auto write = [&](const std::string& name, const std::array<float, 3>& colour) {
    create_folders(folder);
    write_exr(folder / (name + ".exr"), uniform_light(width, height, colour));
    return folder / (name + ".exr");
  };
  if (std::ranges::find(lights, "primary", &CaptureLight::kind) == lights.end()) {
    const std::array<std::pair<const char*, std::array<float, 3>>, 3> primaries = {
        {{"primary_red", {white, 0, 0}}, {"primary_green", {0, white, 0}}, {"primary_blue", {0, 0, white}}}};
    for (auto light = lights.begin(); const auto& [name, colour] : primaries)
      light = 1 + lights.insert(light, {name, FrameRole::train, "primary", write(name, colour)});
  }
  fs::path reference;
  for (const CaptureLight& light : lights)
    if (light.kind == "white" && reference.empty()) reference = light.wanted;
  std::erase_if(lights, [](const CaptureLight& light) { return light.role == FrameRole::reference; });
  return reference.empty() ? write("reference", {white, white, white}) : reference;
}

std::vector<CaptureLight> lights_of_session(const fs::path& folder) {
  std::vector<CaptureLight> lights;
  for (const CaptureFrame& frame : read_capture_session(folder).frames)
    lights.push_back({frame.name, frame.role, frame.kind, frame.illumination});
  return lights;
}

std::vector<CaptureLight> with_references(const std::vector<CaptureLight>& lights, int every,
                                          fs::path reference) {
  if (every <= 0 || lights.empty()) return lights;
  if (reference.empty()) {
    const auto white = std::ranges::find(lights, "white", &CaptureLight::kind);
    reference = (white != lights.end() ? *white : lights.front()).wanted;
  }
  std::vector<CaptureLight> result;
  int count = 0;
  const auto add_reference = [&] {
    result.push_back({formatted("reference_%03d", count++), FrameRole::reference, "reference", reference});
  };
  for (std::size_t i = 0; i < lights.size(); ++i) {
    if (i % static_cast<std::size_t>(every) == 0) add_reference();
    result.push_back(lights[i]);
  }
  add_reference();
  return result;
}

}  // namespace refield::cli
