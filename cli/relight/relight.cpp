// SPDX-License-Identifier: Apache-2.0
#include "relight/relight.h"
#include "cli/run_context.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "cli/common/options.h"
#include "cli/relight/light_series.h"
#include "cli/verbs.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/output_lock.h"
#include "core/field_io/reflectance_field_file.h"

namespace refield::cli {

namespace {

namespace fs = std::filesystem;

/// Whether the output names the image itself: one file of light, named as it is, and no folder.
bool names_one_image(const RelightOptions& options, const LightSeries& series) {
  const auto& patterns = options.lights.empty() ? options.environments : options.lights;
  return !series.is_sequence && patterns.size() == 1 && series.lights.size() == 1 &&
         series.lights[0].source == fs::path(patterns[0]) && options.output.has_extension() &&
         !fs::is_directory(options.output);
}

/// Refuses a folder that would be named like an image or a video: the user expects a file there.
void require_folder_name(const fs::path& output) {
  constexpr std::array<std::string_view, 12> extensions = {".exr", ".png",  ".jpg", ".jpeg", ".tif", ".tiff",
                                                           ".hdr", ".webp", ".gif", ".mov",  ".avi", ".mkv"};
  std::string extension = output.extension();
  std::ranges::transform(extension, extension.begin(), [](unsigned char c) { return std::tolower(c); });
  if (fs::is_directory(output) || std::ranges::find(extensions, extension) == extensions.end()) return;
  throw InputError(
      output.string() +
      ": has the name of a single image, but several images are written; give a folder or a video (.mp4)");
}

std::vector<RelightJob> jobs_of(const RelightOptions& options, const LightSeries& series) {
  const bool single = names_one_image(options, series);
  if (!single) require_folder_name(options.output);
  std::vector<RelightJob> jobs;
  std::set<fs::path> outputs;
  for (const SeriesLight& light : series.lights) {
    const fs::path output = single ? options.output : options.output / (light.name + "." + options.format);
    require_not_an_input(output, {options.field, light.source.value_or(fs::path())});
    if (!outputs.insert(output).second)
      throw InputError(light.source->string() + ": another light of the same name is also written to " +
                       output.string() + "; rename one of them or use different output folders");
    jobs.push_back({light.make, output});
  }
  if (fs::is_regular_file(options.output) && jobs.front().output != options.output)
    throw InputError(options.output.string() + ": is a file, but several images are written; give a folder");
  return jobs;
}

/// For fewer pictures, laying the field out takes longer than it saves.
constexpr std::size_t min_pictures_for_layout = 12;

FieldPictures pictures_of(const RelightOptions& options, const ReflectanceField& field, std::size_t count,
                          RelightPrecision precision) {
  FieldPictures pictures(field, cameras_of(options.camera, field, options.field, options.frames));
  if (options.camera.show_environment) pictures.show_background();
  if (count >= min_pictures_for_layout) pictures.lay_out(precision);
  return pictures;
}

struct Written {
  std::vector<std::string> files;
  ExposureReport exposure;
};

Written write_images(const RelightOptions& options, const ReflectanceField& field,
                     const LightSeries& series) {
  const auto jobs = jobs_of(options, series);
  create_folders(fs::absolute(jobs.front().output).parent_path());
  Written written;
  written.exposure = relight_to_files(pictures_of(options, field, jobs.size(), RelightPrecision::fine), jobs,
                                      {options.video.exposure, series.is_sequence}, run_context());
  for (const RelightJob& job : jobs) written.files.push_back(job.output.string());
  return written;
}

Written write_video(const RelightOptions& options, const ReflectanceField& field, const LightSeries& series) {
  std::vector<LightFunction> lights;
  for (const SeriesLight& light : series.lights) lights.push_back(light.make);
  create_folders(fs::absolute(options.output).parent_path());
  return {{options.output.string()},
          relight_to_video(pictures_of(options, field, lights.size(), RelightPrecision::fast), lights,
                           options.output, options.video, run_context())};
}

void relight(const RelightOptions& options, const Common& common) {
  options.video.check();
  std::vector<fs::path> inputs = {options.field, options.area_lights};
  for (const auto* patterns : {&options.lights, &options.environments})
    inputs.insert(inputs.end(), patterns->begin(), patterns->end());
  const OutputLock lock(options.output, inputs);
  const ReflectanceField field = read_reflectance_field(options.field, run_context());
  const LightSeries series = light_series(options, field);
  const bool is_video = options.output.extension() == ".mp4";
  const Written written =
      is_video ? write_video(options, field, series) : write_images(options, field, series);
  warn_of_clipping(written.exposure.clipped);
  warn_of_unobserved_light(written.exposure.light_shares);
  if (common.json) {
    nlohmann::ordered_json figures{{is_video ? "videos" : "images", written.files}};
    if (!written.exposure.factors.empty()) figures["exposures"] = written.exposure.factors;
    const LightShares& shares = written.exposure.light_shares;
    if (shares.interpolated > 0.0) figures["interpolated_light"] = shares.interpolated;
    if (shares.unobserved > 0.0) figures["unobserved_light"] = shares.unobserved;
    if (series.seen) figures["seen_by_monitor"] = series.seen->json();
    print_json(figures);
    return;
  }
  if (series.seen) series.seen->print();
  if (!options.video.exposure) print_exposures(written.files, written.exposure.factors);
}

void add_light_options(CLI::App& verb, RelightOptions& options) {
  verb.add_option(
      "--light", options.lights,
      "Light maps: a file with the size of the field's light map (EXR: linear; PNG, JPEG: sRGB). For "
      "several maps, a quoted pattern or a folder, the output is a folder");
  verb.add_option(
      "--env", options.environments,
      "Environment map of any size, lat-long (twice as wide as high) or cube (six faces, stacked "
      "vertically). A field captured in front of a monitor is lit by the part of the environment inside "
      "the monitor's window. For several maps, a quoted pattern or a folder, the output is a folder or, with "
      "--frames, a sequence that fades from each map to the next");
  verb.add_option("--yaw", options.turn.yaw,
                  "Rotation of the environment to the right, in degrees (default: 0)");
  const auto bar = verb.add_option("--bar", options.bar,
                                   "Width of a white vertical bar that moves from left to right, as a "
                                   "fraction of the width of the light map (0.125 in the paper)")
                       ->check(CLI::Range(1e-6, 1.0));
  verb.add_flag("--rotate", options.rotate,
                "Rotate the environment, or one lat-long light map, by 360 degrees about the vertical axis")
      ->excludes(bar);
  verb.add_flag(
      "--day", options.day,
      "Light the scene by a clear sky from sunrise to sunset; without --yaw the camera looks south");
  verb.add_option("--frames", options.frames, "Number of images in the sequence")
      ->check(CLI::Range(1, 1'000'000));
  const char* group = "Light";
  verb.add_option("--area-lights", options.area_lights,
                  "Area lights that move around a mesh (.toml, docs/reference/scene-files.md)")
      ->group(group);
  verb.add_option("--latitude", options.sky.latitude_degrees,
                  "Latitude in degrees for --day, which determines the elevation of the sun")
      ->capture_default_str()
      ->group(group);
  verb.add_option("--pitch", options.turn.pitch,
                  "Downward rotation of the environment in front of the camera, in degrees (default: 0)")
      ->group(group);
  verb.add_option(
          "--roll", options.turn.roll,
          "Rotation of the environment about the viewing direction, right side up, in degrees (default: 0)")
      ->group(group);
  add_placement_option(verb, options.placements, "Replaces that of the field.")->group(group);
}

}  // namespace

void add_relight(CLI::App& app, const Common& common, Action& action) {
  const auto options = std::make_shared<RelightOptions>();
  CLI::App* verb = app.add_subcommand(
      "relight",
      "Render images or videos of a reflectance field under new illumination.\n"
      "\n"
      "docs/guide/relighting.md shows the directions of yaw, pitch and roll.\n"
      "\n"
      "Examples:\n"
      "  refield relight scene.rfield --light map.exr -o out.exr\n"
      "  refield relight scene.rfield --env sky.exr --yaw 90 -o out.png\n"
      "  refield relight scene.rfield --env sky.exr --rotate --frames 120 -o rotation.mp4\n"
      "  refield relight scene.rfield --day --yaw 90 --frames 240 -o day.mp4\n"
      "  refield relight scene.rfield --bar 0.125 --frames 60 -o bar\n"
      "  refield relight bunny.rfield --env sky.exr --turntable --frames 120 -o turntable.mp4");
  verb->add_option("field", options->field, "Reflectance field (.rfield)")->required();
  add_light_options(*verb, *options);
  add_camera_options(*verb, options->camera);
  verb->add_option(
          "-o,--output", options->output,
          "Image (.exr, .png), folder for several images, video (.mp4, requires ffmpeg), or of a mesh "
          "field the mesh with its light as vertex colours (.glb)")
      ->required();
  verb->add_option("--format", options->format,
                   "File format of images in a folder: exr, png or glb (default: exr)")
      ->check(CLI::IsMember({"exr", "png", "glb"}));
  add_fps_option(*verb, options->video.frames_per_second);
  add_exposure_option(*verb, options->video.exposure);
  verb->callback([options, &common, &action] { action = [options, &common] { relight(*options, common); }; });
}

}  // namespace refield::cli
