// SPDX-License-Identifier: Apache-2.0
// refield acquire lights: photographs or panorama views of any size become lights of the monitor's size.
#include <algorithm>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "cli/acquire/verbs.h"
#include "core/errors.h"
#include "core/files.h"
#include "core/image_io.h"
#include "core/interrupt.h"
#include "core/progress.h"
#include "core/resample.h"

namespace refield::cli {

namespace {

namespace fs = std::filesystem;

struct LightsOptions {
  std::vector<std::string> images;
  fs::path output;
  std::string size;
  bool stretch = false;
  double peak = 1.0;
  std::vector<double> steps;
  bool force = false;
};

std::pair<int, int> size_of(const std::string& text) {
  int width = 0, height = 0, end = 0;
  if (std::sscanf(text.c_str(), "%dx%d%n", &width, &height, &end) != 2 ||
      text[static_cast<std::size_t>(end)] != '\0' || width < 1 || height < 1 || width > 16384 ||
      height > 16384)
    throw InputError("--size: '" + text + "' is no size; give texels as WIDTHxHEIGHT, such as 800x600");
  return {width, height};
}

/// "name", or with brightness steps "name_x0.25" and so on.
std::string name_of(const fs::path& image, double step, bool stepped) {
  char text[32];
  std::snprintf(text, sizeof text, "_x%.4g", step);
  return image.stem().string() + (stepped ? text : "") + ".exr";
}

void make_lights_of(const LightsOptions& options, const Common& common) {
  const auto [width, height] = size_of(options.size);
  if (!(options.peak > 0.0)) throw InputError("--peak must be above zero");
  std::vector<double> steps = options.steps;
  if (steps.empty()) steps = {1.0};
  for (double step : steps)
    if (!(step > 0.0 && step <= 1.0))
      throw InputError("--steps: " + std::to_string(step) +
                       " is no part of the full brightness; give more than 0, at most 1");
  const auto images = expand_globs(options.images);
  const auto target_of = [&](const fs::path& image, double step) {
    return options.output / name_of(image, step, !options.steps.empty());
  };
  for (const fs::path& image : images)
    for (double step : steps)
      if (!options.force && fs::exists(target_of(image, step)))
        throw InputError(target_of(image, step).string() + ": is there already; --force replaces it");
  create_folders(options.output);
  Progress progress("resampling lights", images.size());
  double clipped = 0.0;
  for (const fs::path& path : images) {
    throw_if_interrupted();
    const Image image = read_light_map(path, Parameterisation::monitor).radiance;
    const Image light =
        options.stretch ? resample_area(image, width, height) : resample_area_cropped(image, width, height);
    clipped += static_cast<double>(std::ranges::count_if(light.values, [](float v) { return v > 1.0f; })) /
               static_cast<double>(light.values.size() * images.size());
    for (double step : steps) {
      Image shown = light;
      for (float& value : shown.values)
        value = static_cast<float>(step * options.peak) * std::min(value, 1.0f);
      write_exr(target_of(path, step), shown);
    }
    progress.advance();
  }
  const std::size_t count = images.size() * steps.size();
  if (common.json)
    std::printf("%s\n",
                nlohmann::ordered_json{
                    {"lights", count}, {"width", width}, {"height", height}, {"clipped_fraction", clipped}}
                    .dump(2)
                    .c_str());
  else
    std::printf("%s: %zu lights of %d×%d; %.2f %% of the samples were brighter than white and cut off\n",
                options.output.c_str(), count, width, height, 100.0 * clipped);
}

}  // namespace

void add_acquire_lights(CLI::App& group, const Common& common, Action& action) {
  const auto options = std::make_shared<LightsOptions>();
  CLI::App* verb = group.add_subcommand(
      "lights",
      "Make lights of the monitor's size from images of any size.\n"
      "Each texel becomes the mean of the linear radiance over its area of the image, so that light is "
      "neither lost\n"
      "nor made. PNG and JPEG are decoded from sRGB; 1 is white, what is brighter is cut off.\n\n"
      "Example:\n"
      "  refield acquire lights photos --size 800x600 -o lights\n"
      "  refield acquire lights 'kitchen*.jpg' --size 1920x1080 --steps 1,0.25 -o lights");
  verb->add_option("images", options->images, "Images: files, folders or quoted patterns")->required();
  verb->add_option("--size", options->size, "Of the lights in texels, WIDTHxHEIGHT")->required();
  verb->add_option("-o,--output", options->output, "Folder for the lights (.exr)")->required();
  verb->add_flag("--stretch", options->stretch,
                 "Show all of each image, stretched; default: its middle part with the lights' proportions");
  verb->add_option("--peak", options->peak, "Radiance that white stands for: the monitor's, above its black")
      ->capture_default_str();
  verb->add_option("--steps", options->steps,
                   "Brightness steps, parts of the full one, separated by commas: each image at each of them")
      ->delimiter(',');
  verb->add_flag("--force", options->force, "Replace lights of the same names");
  verb->callback(
      [options, &common, &action] { action = [options, &common] { make_lights_of(*options, common); }; });
}

}  // namespace refield::cli
