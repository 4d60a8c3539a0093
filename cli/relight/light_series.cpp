// SPDX-License-Identifier: Apache-2.0
#include "relight/light_series.h"

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "common/options.h"
#include "run_context.h"

namespace refield::cli {

namespace {

bool are_given(const CameraOptions& options) {
  return !options.position.empty() || !options.target.empty() || options.fov || !options.size.empty() ||
         options.turntable || options.show_environment;
}

std::array<float, 3> point_of(const std::vector<float>& numbers) {
  return {numbers[0], numbers[1], numbers[2]};
}

namespace fs = std::filesystem;

/// "bar_0007"
std::string frame_name(const char* what, int frame) {
  const std::string number = std::to_string(frame);
  return std::string(what) + '_' + std::string(number.size() < 4 ? 4 - number.size() : 0, '0') + number;
}

/// The one file that is to be turned. Throws InputError naming `option` when it is not one.
fs::path only_file(const std::vector<std::string>& patterns, const char* option) {
  const auto files = expand_globs(patterns);
  if (files.size() != 1) throw InputError("--rotate requires exactly one map; give one ", option);
  return files[0];
}

void add_lights(const RelightOptions& options, const Field& field, LightSeries& series) {
  for (const fs::path& file : expand_globs(options.lights)) {
    require_light(field, file);
    series.add(file.stem().string(), file, [file, kind = field.light_domain().parameterisation] {
      return read_light_map(file, kind, run_context());
    });
  }
}

void add_rotated_light(const RelightOptions& options, const Field& field, LightSeries& series) {
  const fs::path file = only_file(options.lights, "--light");
  require_light(field, file);
  const auto light = std::make_shared<const LightMap>(
      read_light_map(file, field.light_domain().parameterisation, run_context()));
  rotated(*light, 0.0);  // complains about a map that cannot turn before anything is written
  for (int i = 0; i < options.frames; ++i)
    series.add(frame_name("rotation", i), file,
               [=, n = options.frames] { return rotated(*light, static_cast<double>(i) / n); });
}

void add_bar(const RelightOptions& options, const Field& field, LightSeries& series) {
  for (int i = 0; i < options.frames; ++i)
    series.add(frame_name("bar", i), std::nullopt,
               [=, domain = field.light_domain(), width = options.bar, n = options.frames] {
                 return sliding_bar(domain, width, i, n);
               });
}

void add_area_lights(const RelightOptions& options, const Field& field, LightSeries& series) {
  const AreaLights lights(field, options.area_lights, run_context());
  const double last = std::max(1, options.frames - 1);
  for (int i = 0; i < options.frames; ++i)
    series.add(frame_name("area_lights", i), options.area_lights,
               [=, time = lights.duration() * i / last] { return lights.light(time); });
}

/// One light for all frames of a sequence in which the camera alone moves.
void hold_still(LightSeries& series, int frames) {
  if (series.lights.size() != 1)
    throw InputError("--turntable requires exactly one light map or one light sequence; give one map");
  const auto source = series.pictures[0].source;
  series.pictures.clear();
  for (int i = 0; i < frames; ++i) series.pictures.push_back({frame_name("turntable", i), source});
  series.is_sequence = true;
}

void add_maps(const RelightOptions& options, LightSeries& series) {
  for (const fs::path& file : expand_globs(options.environments))
    series.add(file.stem().string(), file, [file, turn = options.turn] {
      return TurnedEnvironment{Environment(file, run_context()), turn};
    });
}

void add_rotation(const RelightOptions& options, LightSeries& series) {
  const fs::path file = only_file(options.environments, "--env");
  const Environment environment(file, run_context());
  for (int i = 0; i < options.frames; ++i) {
    EulerAngles turn = options.turn;
    turn.yaw += 360.0 * i / options.frames;
    series.add(frame_name("rotation", i), file, [=] { return TurnedEnvironment{environment, turn}; });
  }
}

void add_day(const RelightOptions& options, LightSeries& series) {
  options.sky.check();
  for (int i = 0; i < options.frames; ++i) {
    const double day = options.frames == 1 ? 0.5 : static_cast<double>(i) / (options.frames - 1);
    series.add(frame_name("day", i), std::nullopt, [=, sky = options.sky, turn = options.turn] {
      return TurnedEnvironment{Environment(day, sky, run_context()), turn};
    });
  }
}

/// Light adds up, so maps are put onto the light map once, and their lights mixed.
void add_fade(const RelightOptions& options, const Field& field, LightSeries& series) {
  const auto files = expand_globs(options.environments);
  if (files.size() < 2)
    throw InputError("--frames requires a motion; give several maps of --env, --rotate or --turntable");
  const auto monitors = options.pictures.monitors.empty() ? field.monitors() : options.pictures.monitors;
  const auto lights = std::make_shared<std::vector<LightMap>>();
  for (const fs::path& file : files) {
    EnvironmentShare share;
    lights->push_back(Environment(file, run_context())
                          .project(field.light_domain(), monitors, options.turn, run_context(), &share));
    if (!monitors.empty()) series.seen.push_back({file.stem().string(), share});
  }
  for (int i = 0; i < options.frames; ++i) {
    const double last = static_cast<double>(files.size()) - 1.0;
    const double place = options.frames == 1 ? 0.0 : last * i / (options.frames - 1);
    const auto from = std::min(static_cast<std::size_t>(place), files.size() - 2);
    series.add(frame_name("fade", i), files[from], [=] {
      return mixed((*lights)[from], (*lights)[from + 1], place - static_cast<double>(from));
    });
  }
}

/// Refuses environments without the placement of the monitor that shows them, and a placement without one.
void check_monitors(const RelightOptions& options, const Field& field) {
  const LightDomain domain = field.light_domain();
  const bool has_window = domain.parameterisation == Parameterisation::monitor;
  if (has_window && options.placements.empty() && field.monitors().empty())
    throw InputError(options.field,
                     ": does not contain the placement of the monitor, which environment maps require; give "
                     "width x height @ distance from the scene in mm, such as --placement 520x320@600,yaw=90 "
                     "(see docs/guide/relighting.md)");
  if (!has_window && !options.placements.empty())
    throw InputError(options.field, ": has a ", name_of(domain.parameterisation),
                     " light map that covers all directions; remove --placement");
}

/// Maps, turning maps, fades from map to map, days.
void add_environments(const RelightOptions& options, const Field& field, LightSeries& series) {
  check_monitors(options, field);
  series.is_sequence = options.rotate || options.fades() || options.day;
  if (options.day)
    add_day(options, series);
  else if (options.fades())
    add_fade(options, field, series);
  else if (options.rotate)
    add_rotation(options, series);
  else
    add_maps(options, series);
}

void check(const RelightOptions& options) {
  const int kinds = (options.bar > 0.0 ? 1 : 0) + (options.lights.empty() ? 0 : 1) +
                    (options.environments.empty() ? 0 : 1) + (options.day ? 1 : 0) +
                    (options.area_lights.empty() ? 0 : 1);
  if (kinds != 1)
    throw InputError(
        "exactly one kind of light is required; give one of --light, --env, --day, --bar and --area-lights");
  const bool is_motion = options.bar > 0.0 || options.rotate || options.day || options.fades() ||
                         options.camera.turntable || !options.area_lights.empty();
  if (is_motion != (options.frames > 0))
    throw InputError(
        "--frames is required by, and only valid with, --bar, --rotate, --day, --area-lights, --turntable or "
        "several maps of --env; give the number of images in the sequence");
  const bool is_environment = !options.environments.empty() || options.day;
  if (!is_environment && (!options.turn.is_none() || !options.placements.empty()))
    throw InputError(
        "--yaw, --pitch, --roll and --placement require an environment; give --env or --day, or remove them");
}

}  // namespace

void add_camera_options(CLI::App& verb, CameraOptions& options) {
  const char* group =
      "Camera (mesh fields only; default: the camera of the scene, else a front view of the whole mesh)";
  const auto add_point = [&](const char* name, std::vector<float>& point, const char* what) {
    verb.add_option(name, point, what)->delimiter(',')->expected(3)->type_name("X,Y,Z")->group(group);
  };
  verb.add_flag("--turntable", options.turntable,
                "Move the camera on a full circle around the target over --frames images")
      ->group(group);
  add_point("--camera-position", options.position,
            "Position of the camera in scene coordinates (+X right, +Y up, +Z forward)");
  add_point("--camera-target", options.target,
            "Point in scene coordinates that is in the centre of the image");
  verb.add_option("--vertical-fov", options.fov, "Vertical field of view in degrees")->group(group);
  verb.add_option("--size", options.size, "Size of the picture in pixels")
      ->type_name("WIDTHxHEIGHT")
      ->group(group);
  verb.add_flag("--show-environment", options.show_environment,
                "Show the environment behind the mesh, instead of transparency (EXR, PNG) or black (videos)")
      ->group(group);
}

std::vector<ViewCamera> cameras_of(const CameraOptions& options, const Field& field,
                                   const std::filesystem::path& path, int frames) {
  if (!field.has_mesh()) {
    if (are_given(options))
      throw InputError(
          path,
          ": was captured by a fixed camera and has no mesh, so the view cannot change; remove "
          "--camera-position, --camera-target, --vertical-fov, --size, --turntable and --show-environment");
    return {};
  }
  const PictureSize size = options.size.empty() ? PictureSize() : read_picture_size(options.size, {1, 1});
  ViewCamera camera = standard_camera(field, size.width, size.height);
  if (!options.position.empty()) camera.position = point_of(options.position);
  if (!options.target.empty()) camera.target = point_of(options.target);
  if (options.fov) camera.vertical_field_of_view_degrees = *options.fov;
  return options.turntable ? turntable(camera, frames) : std::vector{camera};
}

void print_seen(const std::vector<SeenShare>& seen) {
  constexpr std::size_t max_lines = 12;
  if (seen.empty()) return;
  std::printf("The monitor covers %.1f %% of all directions; light from other directions is ignored.\n",
              100.0 * seen.front().share.sphere);
  if (seen.size() <= max_lines) {
    for (const SeenShare& one : seen)
      std::printf("%s: %.1f %% of the map's light comes from these directions\n", one.light.c_str(),
                  100.0 * one.share.energy);
    return;
  }
  const auto energy = [](const SeenShare& one) { return one.share.energy; };
  const auto [least, most] = std::ranges::minmax_element(seen, {}, energy);
  std::printf("%.1f %% (%s) to %.1f %% (%s) of the maps' light comes from these directions\n",
              100.0 * energy(*least), least->light.c_str(), 100.0 * energy(*most), most->light.c_str());
}

Json seen_figures(const std::vector<SeenShare>& seen) {
  Json list = Json::array();
  for (const SeenShare& one : seen)
    list.push_back({{"light", one.light},
                    {"share_of_directions", one.share.sphere},
                    {"share_of_light", one.share.energy}});
  return list;
}

LightSeries light_series(const RelightOptions& options, const Field& field) {
  check(options);
  LightSeries series{.is_sequence = options.bar > 0.0 || !options.area_lights.empty() || options.rotate};
  if (options.bar > 0.0)
    add_bar(options, field, series);
  else if (!options.area_lights.empty())
    add_area_lights(options, field, series);
  else if (options.day || !options.environments.empty())
    add_environments(options, field, series);
  else if (options.rotate)
    add_rotated_light(options, field, series);
  else
    add_lights(options, field, series);
  if (options.camera.turntable && !series.is_sequence) hold_still(series, options.frames);
  return series;
}

}  // namespace refield::cli
