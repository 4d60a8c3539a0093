// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "cli/verbs.h"
#include "core/errors.h"
#include "core/files.h"
#include "core/image_io.h"
#include "core/reflectance_field_file.h"
#include "relight/relight.h"
#include "relight/sequence.h"

namespace refield::cli {

namespace {

namespace fs = std::filesystem;

struct RelightOptions {
  fs::path field;
  std::vector<std::string> lights;
  fs::path output;
  double bar = 0.0;  ///< width as a fraction of the light map; 0: no bar
  bool rotate = false;
  int frames = 0;
  std::string format = "exr";
  double exposure = 1.0;
};

void require_other_file(const fs::path& output, const fs::path& input) {
  std::error_code error;
  if (fs::equivalent(output, input, error))
    throw InputError(output.string() + ": is also an input; give another output");
}

/// Checked before anything is written.
void require_light_size(const fs::path& light, const LightDomain& domain) {
  const ImageHeader header = read_image_header(light);
  if (header.width != domain.width || header.height != domain.height)
    throw InputError(
        light.string() + ": is " + std::to_string(header.width) + "×" + std::to_string(header.height) +
        " texels, the field expects a " + std::string(name_of(domain.parameterisation)) + " light map of " +
        std::to_string(domain.width) + "×" + std::to_string(domain.height) + "; resample it to that size");
}

std::vector<fs::path> light_files(const std::vector<std::string>& patterns) {
  std::vector<fs::path> files;
  for (const std::string& pattern : patterns) {
    if (fs::is_regular_file(pattern)) {  // its name may hold wildcard characters
      files.emplace_back(pattern);
    } else {
      for (const GlobMatch& match : expand_glob(pattern)) files.push_back(match.path);
    }
  }
  return files;
}

fs::path frame_name(const char* what, int frame, const std::string& format) {
  char name[64];
  std::snprintf(name, sizeof name, "%s_%04d.%s", what, frame, format.c_str());
  return name;
}

std::vector<RelightJob> jobs_of_lights(const RelightOptions& options, const LightDomain& domain) {
  const auto lights = light_files(options.lights);
  const bool single = options.lights.size() == 1 && lights.size() == 1 &&
                      fs::path(options.lights[0]) == lights[0] && options.output.has_extension() &&
                      !fs::is_directory(options.output);
  std::vector<RelightJob> jobs;
  std::set<fs::path> outputs;
  for (const fs::path& light : lights) {
    const fs::path output =
        single ? options.output : options.output / (light.stem().string() + "." + options.format);
    require_light_size(light, domain);
    require_other_file(output, light);
    if (!outputs.insert(output).second)
      throw InputError(light.string() + ": another light of that name goes to " + output.string() +
                       " too; rename one or relight them into different folders");
    jobs.push_back({[light, domain] { return read_light_map(light, domain.parameterisation); }, output});
  }
  return jobs;
}

std::vector<RelightJob> jobs_of_sequence(const RelightOptions& options, const LightDomain& domain) {
  std::vector<RelightJob> jobs;
  if (options.rotate) {
    const auto lights = light_files(options.lights);
    if (lights.size() != 1) throw InputError("--rotate turns one light map; give exactly one --light");
    require_light_size(lights[0], domain);
    const auto light = std::make_shared<const LightMap>(read_light_map(lights[0], domain.parameterisation));
    for (int i = 0; i < options.frames; ++i)
      jobs.push_back({[=, n = options.frames] { return rotated(*light, static_cast<double>(i) / n); },
                      options.output / frame_name("rotation", i, options.format)});
    rotated(*light, 0.0);  // complains about a map that cannot turn before anything is written
    return jobs;
  }
  for (int i = 0; i < options.frames; ++i)
    jobs.push_back({[=, width = options.bar, n = options.frames] { return sliding_bar(domain, width, i, n); },
                    options.output / frame_name("bar", i, options.format)});
  return jobs;
}

void relight(const RelightOptions& options, const Common& common) {
  const bool sequence = options.bar > 0.0 || options.rotate;
  if (!sequence && options.lights.empty()) throw InputError("nothing to relight with; give --light or --bar");
  if (options.bar > 0.0 && !options.lights.empty())
    throw InputError("--bar makes its own light; leave --light out");
  if (sequence != (options.frames > 0))
    throw InputError("--frames goes with --bar or --rotate; give the sequence's number of frames");
  const ReflectanceField field = read_reflectance_field(options.field);
  const auto jobs =
      sequence ? jobs_of_sequence(options, field.basis.domain) : jobs_of_lights(options, field.basis.domain);
  require_other_file(jobs.front().output, options.field);
  if (fs::is_regular_file(options.output) && jobs.front().output != options.output)
    throw InputError(options.output.string() +
                     ": is a file, and several images need a folder; give another output");
  create_folders(fs::absolute(jobs.front().output).parent_path());
  relight_to_files(field, jobs, options.exposure);
  if (common.json) {
    nlohmann::ordered_json outputs = nlohmann::ordered_json::array();
    for (const RelightJob& job : jobs) outputs.push_back(job.output.string());
    std::printf("%s\n", nlohmann::ordered_json{{"images", outputs}}.dump(2).c_str());
  }
}

}  // namespace

void add_relight(CLI::App& app, const Common& common, Action& action) {
  const auto options = std::make_shared<RelightOptions>();
  CLI::App* verb = app.add_subcommand("relight", "Show a captured scene under new light");
  verb->add_option("field", options->field, "Reflectance field (.rfield)")->required();
  verb->add_option(
      "--light", options->lights,
      "Light map of the field's size (EXR: linear; PNG, JPEG: sRGB). Several, a quoted pattern or a "
      "folder: the output is a folder");
  verb->add_option("-o,--output", options->output, "Image (.exr, .png), or a folder for several")->required();
  const auto bar =
      verb->add_option(
              "--bar", options->bar,
              "Light the scene by a white vertical bar that slides from left to right; its width as a "
              "fraction of the light map's (the paper: 0.125)")
          ->check(CLI::Range(1e-6, 1.0));
  verb->add_flag("--rotate", options->rotate,
                 "Turn one lat-long light map a full circle about the vertical axis")
      ->excludes(bar);
  verb->add_option("--frames", options->frames, "Images in the sequence")->check(CLI::Range(1, 1'000'000));
  verb->add_option("--format", options->format, "Of images in a folder: exr (default) or png")
      ->check(CLI::IsMember({"exr", "png"}));
  verb->add_option("--exposure", options->exposure, "Factor on the radiance for PNG output")
      ->check(CLI::PositiveNumber);
  verb->callback([options, &common, &action] { action = [options, &common] { relight(*options, common); }; });
}

}  // namespace refield::cli
