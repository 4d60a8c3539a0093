// SPDX-License-Identifier: Apache-2.0
// refield acquire lights: patterns of the monitor's size, made from images of any size or from a seed.
#include <cmath>
#include <cstdio>

#include "cli/common/options.h"
#include "cli/run_context.h"
#include "cli/verbs.h"
#include "core/base/files.h"
#include "core/base/json.h"
#include "core/base/output_lock.h"
#include "core/image/image.h"
#include "core/image/image_io.h"
#include "core/image/tone_map.h"
#include "simulate/rig/light_maps.h"

namespace refield::cli {

namespace {

struct LightsOptions {
  std::vector<std::string> images;
  bool starter = false;
  bool spots = false;
  std::string kind = "designed";
  int patterns = 180;
  fs::path output;
  fs::path png;
  std::string size;
  bool force = false;
};

std::pair<int, int> size_of(const std::string& text) {
  const PictureSize size = read_picture_size(text, {1, 1}, "--light-size");
  return {size.width, size.height};
}

/// Writes patterns, linear radiance from 0 to 1, as OpenEXR and, where asked for, as PNG.
class PatternWriter {
 public:
  /// Files are written that are named after `names`; none of them may be one of `inputs`.
  PatternWriter(const LightsOptions& options, const std::vector<std::string>& names,
                const std::vector<fs::path>& inputs = {})
      : options_(options) {
    for (const std::string& name : names)
      for (const fs::path& file : {exr_of(name), png_of(name)})
        if (!options.force && !file.empty() && fs::exists(file))
          throw InputError(file, ": already exists; give --force to replace it");
        else
          require_not_an_input(file, inputs);
    create_folders(options.output);
    if (!options.png.empty()) create_folders(options.png);
    lock_.emplace(options.output, std::vector<fs::path>{});
  }

  void write(const std::string& name, const Image& light) const {
    Image shown = light;
    for (float& value : shown.values) value = std::min(value, 1.0f);
    if (!options_.png.empty()) {
      // What the file is to stand for is what the monitor shows: the 8-bit levels, decoded.
      ScreenImage screen{shown.width, shown.height, 3, tone_mapped(shown, ToneMapping{})};
      for (std::size_t i = 0; i < shown.values.size(); ++i)
        shown.values[i] = linear_from_srgb(static_cast<float>(screen.levels[i]) * (1.0f / 255.0f));
      write_png(png_of(name), screen);
    }
    write_exr(exr_of(name), shown);
  }

 private:
  fs::path exr_of(const std::string& name) const { return options_.output / (name + ".exr"); }
  fs::path png_of(const std::string& name) const {
    return options_.png.empty() ? fs::path() : options_.png / (name + ".png");
  }

  const LightsOptions& options_;
  std::optional<OutputLock> lock_;
};

void report(const LightsOptions& options, std::size_t count, int width, int height, double clipped,
            const Common& common) {
  if (common.json)
    return print_json(
        Json{{"lights", count}, {"width", width}, {"height", height}, {"clipped_fraction", clipped}});
  std::printf("%s: %zu light maps of %d×%d", options.output.c_str(), count, width, height);
  if (!options.starter && !options.spots)
    std::printf("; %.2f %% of the samples were brighter than white and were clipped", 100.0 * clipped);
  std::printf("\n");
  if (!options.png.empty())
    std::printf("%s: the same patterns as 8-bit sRGB images; show them with 'refield acquire show %s'\n",
                options.png.c_str(), options.png.c_str());
}

/// Five sixths are patterns to estimate from; the others are held out, which name the error of an estimate:
/// of 180 patterns 150 and 30.
LightPlan starter_plan(int count, const std::string& kind) {
  const auto share = [&](int of_180) { return std::max(1, of_180 * count / 180); };
  LightPlan plan{.train = 0,
                 .kind = kind,
                 .natural = share(12),
                 .coloured = share(3),
                 .bars = share(8),
                 .squares = share(6),
                 .white = 1,
                 .black = 0};
  plan.train = count - plan.natural - plan.coloured - plan.bars - plan.squares - plan.white;
  return plan;
}

struct FullScreen {
  std::string name;
  std::array<float, 3> colour;
};

/// Each primary alone, and white before the first of the patterns, after every thirtieth and after the last
/// in the order of names: the drift, colours and movement of a capture show in them directly.
std::vector<FullScreen> full_screens(const std::vector<LightSpec>& patterns) {
  constexpr std::size_t every = 30;
  std::vector<std::string> names;
  for (const LightSpec& pattern : patterns) names.push_back(pattern.name);
  std::ranges::sort(names);
  std::vector<FullScreen> screens = {{"primary_blue", {0, 0, 1}},
                                     {"primary_green", {0, 1, 0}},
                                     {"primary_red", {1, 0, 0}},
                                     {"reference", {1, 1, 1}}};
  for (std::size_t i = 1; i <= names.size(); ++i)
    if (i % every == 0 || i == names.size()) screens.push_back({names[i - 1] + "_reference", {1, 1, 1}});
  return screens;
}

void make_starter_set(const LightsOptions& options, const Common& common) {
  const LightPlan plan = starter_plan(options.patterns, options.kind);
  constexpr std::uint64_t seed = 2004;
  const auto [width, height] = size_of(options.size.empty() ? "160x90" : options.size);
  const std::vector<LightSpec> list = list_lights(plan);
  std::vector<std::string> names;
  for (const LightSpec& spec : list) names.push_back(spec.name);
  const std::vector<FullScreen> screens = full_screens(list);
  for (const FullScreen& screen : screens) names.push_back(screen.name);
  const PatternWriter writer(options, names);
  for (const auto& [name, colour] : screens) writer.write(name, uniform_light(width, height, colour));
  make_lights(
      list, {width, height, Parameterisation::monitor}, seed,
      [&](std::size_t place, LightMap&& light) { writer.write(list[place].name, light.radiance); },
      run_context());
  report(options, names.size(), width, height, 0.0, common);
}

/// Spots at the centres of 5 × 3 equal parts of the screen, and white.
void make_spots(const LightsOptions& options, const Common& common) {
  constexpr int columns = 5, rows = 3;
  constexpr double half_side = 0.05;  // of the screen's height
  const auto [width, height] = size_of(options.size.empty() ? "160x90" : options.size);
  std::vector<std::string> names = {"white"};
  for (int i = 0; i < columns * rows; ++i) names.push_back("spot_" + std::to_string(i));
  const PatternWriter writer(options, names);
  writer.write("white", Image(width, height, 3, 1.0f));
  for (int i = 0; i < columns * rows; ++i) {
    const double x = (i % columns + 0.5) * width / columns, y = (i / columns + 0.5) * height / rows;
    Image light(width, height, 3);
    for (int v = 0; v < height; ++v)
      for (int u = 0; u < width; ++u)
        if (std::abs(u + 0.5 - x) <= half_side * height && std::abs(v + 0.5 - y) <= half_side * height)
          for (int c = 0; c < 3; ++c) light.at(u, v, c) = 1.0f;
    writer.write("spot_" + std::to_string(i), light);
  }
  report(options, names.size(), width, height, 0.0, common);
}

void make_lights_of(LightsOptions& options, const Common& common) {
  options.force = common.force;
  if (options.spots) return make_spots(options, common);
  if (options.starter) return make_starter_set(options, common);
  if (options.images.empty())
    throw InputError("no source images are given; give images, or --starter for a set of patterns");
  if (options.size.empty())
    throw InputError("--light-size is missing; give the size of the patterns in texels, such as 800x600");
  const auto [width, height] = size_of(options.size);
  const auto images = expand_globs(options.images);
  std::vector<std::string> names;
  for (const fs::path& image : images) names.push_back(image.stem().string());
  const PatternWriter writer(options, names, images);
  Progress progress(run_context(), "resampling lights", images.size());
  double clipped = 0.0;
  for (const fs::path& path : images) {
    run_context().throw_if_stopped();
    const Image image = read_light_map(path, Parameterisation::monitor, run_context()).radiance;
    const Image light = resample_area_cropped(image, width, height);
    clipped += static_cast<double>(std::ranges::count_if(light.values, [](float v) { return v > 1.0f; })) /
               static_cast<double>(light.values.size() * images.size());
    writer.write(path.stem().string(), light);
    progress.advance();
  }
  report(options, images.size(), width, height, clipped, common);
}

}  // namespace

void add_acquire_lights(CLI::App& group, const Common& common, Action& action) {
  const auto options = std::make_shared<LightsOptions>();
  CLI::App* verb = group.add_subcommand(
      "lights",
      "Create light patterns for a monitor.\n"
      "\n"
      "Patterns are resampled from images of any size, or a starter set of 180 generated patterns. Each "
      "texel is the mean linear radiance over its area of the image. PNG and JPEG files are decoded from "
      "sRGB; 1 is white, higher values are clipped; of other aspect ratios the central part is used. The "
      "starter set is always the same: 150 patterns for training (train_…), designed for estimation "
      "(docs/method/patterns.md), and, held out (test_…), 12 natural patterns, 3 in saturated colours, 8 "
      "bars, 6 squares and white. Beside these 180 it has each primary of the monitor alone (primary_…) and "
      "white as a reference for drift, before, after and between them (reference, …_reference).\n"
      "\n"
      "With --png, each pattern is also written as an 8-bit sRGB image for a monitor. The OpenEXR file then "
      "contains the linear radiance of these 8-bit levels: level L has the radiance sRGB⁻¹(L / 255).\n"
      "\n"
      "Examples:\n"
      "  refield acquire lights --starter -o lights --png patterns\n"
      "  refield acquire lights photos --light-size 800x600 -o lights\n"
      "  refield acquire lights 'kitchen*.jpg' --light-size 1920x1080 -o lights");
  CLI::Option* images =
      verb->add_option("images", options->images, "Images: files, folders or quoted patterns");
  verb->add_flag("--starter", options->starter,
                 "Create the starter set of 180 patterns instead of resampling images")
      ->excludes(images);
  verb->add_flag("--spots", options->spots,
                 "Create 15 spots and white for 'refield acquire geometry' instead of resampling images")
      ->excludes(images)
      ->excludes("--starter");
  verb->add_option("--kind", options->kind,
                   "Training patterns: designed for estimation, or natural images as in the paper")
      ->check(CLI::IsMember({"designed", "natural"}))
      ->capture_default_str();
  verb->add_option(
          "--patterns", options->patterns,
          "Number of patterns of the starter set, held-out ones included; without primaries and references")
      ->check(CLI::Range(12, 5000))
      ->capture_default_str();
  verb->add_option(
          "--light-size", options->size,
          "Size of the light maps in texels (default for --starter and --spots: 160x90, for 16:9 monitors)")
      ->type_name("WIDTHxHEIGHT");
  verb->add_option("-o,--output", options->output, "Folder for the light maps (.exr)")->required();
  verb->add_option("--png", options->png, "Folder for the same patterns as 8-bit sRGB PNG files");
  on_command(*verb, options, common, action, make_lights_of);
}

}  // namespace refield::cli
