// SPDX-License-Identifier: Apache-2.0
#include "refield/relight.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>

#include "common/options.h"
#include "relight/light_series.h"
#include "run_context.h"
#include "verbs.h"

namespace refield::cli {

namespace {

namespace fs = std::filesystem;

/// Whether the output names the image itself: one file of light, named as it is, and no folder.
bool names_one_image(const RelightOptions& options, const LightSeries& series) {
  const auto& patterns = options.lights.empty() ? options.environments : options.lights;
  return !series.is_sequence && patterns.size() == 1 && series.pictures.size() == 1 &&
         series.pictures[0].source == fs::path(patterns[0]) && options.output.has_extension() &&
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
      output,
      ": has the name of a single image, but several images are written; give a folder or a video (.mp4)");
}

std::vector<fs::path> files_of(const RelightOptions& options, const LightSeries& series) {
  const bool single = names_one_image(options, series);
  if (!single) require_folder_name(options.output);
  std::vector<fs::path> files;
  std::set<fs::path> outputs;
  for (const auto& [name, source] : series.pictures) {
    const fs::path output = single ? options.output : options.output / (name + "." + options.format);
    require_not_an_input(output, {options.field, source.value_or(fs::path())});
    if (!outputs.insert(output).second)
      throw InputError(source->string() + ": another light of the same name is also written to " +
                       output.string() + "; rename one of them or use different output folders");
    files.push_back(output);
  }
  if (fs::is_regular_file(options.output) && files.front() != options.output)
    throw InputError(options.output, ": is a file, but several images are written; give a folder");
  return files;
}

/// Prints what became of `files`, and what of the light did not reach the scene.
void report(const RelightOptions& options, LightSeries& series, const std::vector<std::string>& files,
            bool is_video, const PictureReport& made, const Common& common) {
  for (std::size_t i = 0; i < made.seen.size(); ++i)
    series.seen.push_back({series.pictures[i].name, made.seen[i]});
  std::ranges::stable_sort(series.seen, {}, &SeenShare::light);
  warn_of_clipping(made.clipped);
  warn_of_unobserved_light(made.interpolated_light, made.unobserved_light);
  if (common.json) {
    Json figures{{is_video ? "videos" : "images", files}};
    if (!made.exposures.empty()) figures["exposures"] = made.exposures;
    if (made.interpolated_light > 0.0) figures["interpolated_light"] = made.interpolated_light;
    if (made.unobserved_light > 0.0) figures["unobserved_light"] = made.unobserved_light;
    if (!series.seen.empty()) figures["seen_by_monitor"] = seen_figures(series.seen);
    print_json(figures);
    return;
  }
  print_seen(series.seen);
  if (!options.pictures.exposure) print_exposures(files, made.exposures);
}

void relight(RelightOptions options, const Common& common) {
  options.pictures.check();
  std::vector<fs::path> inputs = {options.field, options.area_lights};
  for (const auto* patterns : {&options.lights, &options.environments})
    inputs.insert(inputs.end(), patterns->begin(), patterns->end());
  const auto reserved = reserve_output(options.output, inputs);
  const Field field(options.field, run_context());
  PictureOptions& pictures = options.pictures;
  pictures.monitors = placements_from_texts(options.placements);
  LightSeries series = light_series(options, field);
  const bool is_video = options.output.extension() == ".mp4";
  const auto files = is_video ? std::vector{options.output} : files_of(options, series);
  pictures.cameras = cameras_of(options.camera, field, options.field, options.frames);
  pictures.show_environment = options.camera.show_environment;
  pictures.is_sequence = series.is_sequence;
  const PictureReport made =
      is_video ? relight_to_video(field, series.lights, options.output, pictures, run_context())
               : relight_to_files(field, series.lights, files, pictures, run_context());
  report(options, series, {files.begin(), files.end()}, is_video, made, common);
}

void add_light_options(CLI::App& verb, RelightOptions& options) {
  verb.add_option("--light", options.lights,
                  "Light maps: a file with the size of the field's light map (EXR: linear; PNG, JPEG: sRGB). "
                  "For several maps, a quoted pattern or a folder, the output is a folder");
  verb.add_option("--env", options.environments,
                  "Environment map of any size, lat-long (twice as wide as high) or cube (six faces, stacked "
                  "vertically). A field captured in front of a monitor is lit by the part of the environment "
                  "inside the monitor's window. For several maps, a quoted pattern or a folder, the output "
                  "is a folder or, with --frames, a sequence that fades from each map to the next");
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
  verb->add_option("-o,--output", options->output,
                   "Image (.exr, .png), folder for several images, video (.mp4, requires ffmpeg), or of a "
                   "mesh field the mesh with its light as vertex colours (.glb)")
      ->required();
  verb->add_option("--format", options->format,
                   "File format of images in a folder: exr, png or glb (default: exr)")
      ->check(CLI::IsMember({"exr", "png", "glb"}));
  add_fps_option(*verb, options->pictures.frames_per_second);
  add_exposure_option(*verb, options->pictures.exposure);
  on_command(*verb, options, common, action, relight);
}

}  // namespace refield::cli
