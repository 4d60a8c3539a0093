// SPDX-License-Identifier: Apache-2.0
#include "cli/relight/light_series.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cstdio>

#include "cli/common/options.h"
#include "cli/run_context.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/number_text.h"
#include "core/base/run_context.h"
#include "core/image/image_io.h"
#include "relight/environment/environment.h"
#include "relight/field_pictures.h"
#include "relight/mesh/mesh_view.h"
#include "relight/sequence.h"
#include "simulate/prt/area_lights.h"
#include "simulate/prt/harmonic_transfer.h"

namespace refield::cli {

namespace {

bool are_given(const CameraOptions& options) {
  return !options.position.empty() || !options.target.empty() || options.fov || !options.size.empty() ||
         options.turntable || options.show_environment;
}

Eigen::Vector3f vector_of(const std::vector<float>& numbers) {
  return {numbers[0], numbers[1], numbers[2]};
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

std::vector<PinholeCamera> cameras_of(const CameraOptions& options, const ReflectanceField& field,
                                      const std::filesystem::path& path, int frames) {
  if (!field.mesh) {
    if (are_given(options))
      throw InputError(
          path.string() +
          ": was captured by a fixed camera and has no mesh, so the view cannot change; remove "
          "--camera-position, --camera-target, --vertical-fov, --size, --turntable and --show-environment");
    return {};
  }
  PinholeCamera camera = standard_camera(field);
  if (!options.size.empty()) {
    const PictureSize size = read_picture_size(options.size, {1, 1});
    camera.width = size.width;
    camera.height = size.height;
    if (!field.mesh->camera) camera = framing_camera(*field.mesh, camera.width, camera.height);
  }
  if (!options.position.empty()) camera.position = vector_of(options.position);
  if (!options.target.empty()) camera.target = vector_of(options.target);
  if (options.fov) camera.vertical_field_of_view_degrees = *options.fov;
  camera.check();
  return options.turntable ? turntable(camera, frames) : std::vector{camera};
}

void SeenShares::add(const std::string& light, const EnvironmentShare& share) {
  const std::scoped_lock lock(mutex_);
  entries_.insert(std::ranges::upper_bound(entries_, light, {}, &Entry::light), {light, share});
}

void SeenShares::print() const {
  constexpr std::size_t max_lines = 12;
  if (entries_.empty()) return;
  std::printf("The monitor covers %.1f %% of all directions; light from other directions is ignored.\n",
              100.0 * entries_.front().share.sphere);
  if (entries_.size() <= max_lines) {
    for (const Entry& entry : entries_)
      std::printf("%s: %.1f %% of the map's light comes from these directions\n", entry.light.c_str(),
                  100.0 * entry.share.energy);
    return;
  }
  const auto energy = [](const Entry& entry) { return entry.share.energy; };
  const auto [least, most] = std::ranges::minmax_element(entries_, {}, energy);
  std::printf("%.1f %% (%s) to %.1f %% (%s) of the maps' light comes from these directions\n",
              100.0 * energy(*least), least->light.c_str(), 100.0 * energy(*most), most->light.c_str());
}

nlohmann::ordered_json SeenShares::json() const {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const Entry& entry : entries_)
    list.push_back({{"light", entry.light},
                    {"share_of_directions", entry.share.sphere},
                    {"share_of_light", entry.share.energy}});
  return list;
}

namespace {

namespace fs = std::filesystem;

/// "bar_0007"
std::string frame_name(const char* what, int frame) {
  return formatted("%s_%04d", what, frame);
}

/// The one file that is to be turned. Throws InputError naming `option` when it is not one.
fs::path only_file(const std::vector<std::string>& patterns, const char* option) {
  const auto files = expand_globs(patterns);
  if (files.size() != 1)
    throw InputError(std::string("--rotate requires exactly one map; give one ") + option);
  return files[0];
}

void require_light_size(const fs::path& light, const LightDomain& domain) {
  const ImageHeader header = read_image_header(light);
  if (header.width != domain.width || header.height != domain.height)
    throw InputError(light.string() + ": is " + std::to_string(header.width) + "×" +
                     std::to_string(header.height) + " texels, but the field requires a " +
                     std::string(name_of(domain.parameterisation)) + " light map of " +
                     std::to_string(domain.width) + "×" + std::to_string(domain.height) +
                     "; resample it to that size, or give it with --env if it is an environment map");
}

LightSeries series_of_lights(const RelightOptions& options, const LightDomain& domain) {
  LightSeries series;
  for (const fs::path& file : expand_globs(options.lights)) {
    require_light_size(file, domain);
    series.lights.push_back({file.stem().string(), file,
                             [=] { return read_light_map(file, domain.parameterisation, run_context()); }});
  }
  return series;
}

LightSeries series_of_rotated_light(const RelightOptions& options, const LightDomain& domain) {
  const fs::path file = only_file(options.lights, "--light");
  require_light_size(file, domain);
  const auto light =
      std::make_shared<const LightMap>(read_light_map(file, domain.parameterisation, run_context()));
  rotated(*light, 0.0);  // complains about a map that cannot turn before anything is written
  LightSeries series{.is_sequence = true};
  for (int i = 0; i < options.frames; ++i)
    series.lights.push_back({frame_name("rotation", i), file, [=, n = options.frames] {
                               return rotated(*light, static_cast<double>(i) / n);
                             }});
  return series;
}

LightSeries series_of_bar(const RelightOptions& options, const LightDomain& domain) {
  LightSeries series{.is_sequence = true};
  for (int i = 0; i < options.frames; ++i)
    series.lights.push_back(
        {frame_name("bar", i), std::nullopt,
         [=, width = options.bar, n = options.frames] { return sliding_bar(domain, width, i, n); }});
  return series;
}

LightSeries series_of_area_lights(const RelightOptions& options, const ReflectanceField& field) {
  if (!field.mesh || field.basis.domain.parameterisation != Parameterisation::cube)
    throw InputError("--area-lights requires a mesh field; " + options.field.string() +
                     " is an image field: use --light or --env");
  const auto area_lights =
      std::make_shared<const prt::AreaLights>(prt::read_area_lights(options.area_lights, run_context()));
  const Eigen::Vector3f middle = prt::middle(*field.mesh);
  const double last = std::max(1, options.frames - 1), duration = area_lights->duration();
  LightSeries series{.is_sequence = true};
  for (int i = 0; i < options.frames; ++i)
    series.lights.push_back({frame_name("area_lights", i), options.area_lights,
                             [=, time = duration * i / last, resolution = field.basis.domain.width] {
                               return emitter_map(area_lights->at(time), middle, resolution);
                             }});
  return series;
}

/// One light for all frames of a sequence in which the camera alone moves.
void hold_still(LightSeries& series, int frames) {
  if (series.lights.size() != 1)
    throw InputError("--turntable requires exactly one light map or one light sequence; give one map");
  const auto light = std::make_shared<const SceneLight>(series.lights[0].make());
  const auto source = series.lights[0].source;
  series.lights.clear();
  for (int i = 0; i < frames; ++i)
    series.lights.push_back({frame_name("turntable", i), source, [=] { return *light; }});
  series.is_sequence = true;
}

/// Brings environments into the form that a field is lit by, and keeps count of what the monitor sees of
/// them.
struct Projection {
  std::shared_ptr<const EnvironmentProjector> projector;
  std::shared_ptr<SeenShares> seen;
  bool box_sums = false;  ///< the field needs no light map

  SceneLight operator()(const std::string& name, std::shared_ptr<const PreparedEnvironment> environment,
                        const EulerAngles& turn) const {
    if (box_sums && environment->has_path_sums()) return TurnedEnvironment{std::move(environment), turn};
    return light_map(name, *environment, turn);
  }

  LightMap light_map(const std::string& name, const PreparedEnvironment& environment,
                     const EulerAngles& turn) const {
    EnvironmentLight result = projector->project(environment, turn, run_context());
    if (seen) seen->add(name, result.share);
    return std::move(result.light);
  }
};

std::shared_ptr<const PreparedEnvironment> prepared(LightMap environment) {
  return std::make_shared<const PreparedEnvironment>(std::move(environment), run_context());
}

Projection projection_of(const RelightOptions& options, const ReflectanceField& field) {
  const auto monitors =
      options.placements.empty() ? field.monitors : placements_from_texts(options.placements);
  const LightDomain& domain = field.basis.domain;
  const bool has_window = domain.parameterisation == Parameterisation::monitor;
  if (has_window && monitors.empty())
    throw InputError(options.field.string() +
                     ": does not contain the placement of the monitor, which environment maps require; give "
                     "width x height @ distance from the scene in mm, such as --placement 520x320@600,yaw=90 "
                     "(see docs/guide/relighting.md)");
  if (!has_window && !options.placements.empty())
    throw InputError(options.field.string() + ": has a " + std::string(name_of(domain.parameterisation)) +
                     " light map that covers all directions; remove --placement");
  check_placements(monitors, domain, options.placements.empty() ? options.field.string() : "--placement");
  return {std::make_shared<const EnvironmentProjector>(domain, monitors, run_context()),
          has_window ? std::make_shared<SeenShares>() : nullptr, box_sums_suffice(field.basis)};
}

void add_maps(const RelightOptions& options, const Projection& project, LightSeries& series) {
  for (const fs::path& file : expand_globs(options.environments))
    series.lights.push_back({file.stem().string(), file, [=, turn = options.turn] {
                               return project(file.stem().string(),
                                              prepared(read_environment(file, run_context())), turn);
                             }});
}

void add_rotation(const RelightOptions& options, const Projection& project, LightSeries& series) {
  const fs::path file = only_file(options.environments, "--env");
  const auto environment = prepared(read_environment(file, run_context()));
  for (int i = 0; i < options.frames; ++i) {
    EulerAngles turn = options.turn;
    turn.yaw += 360.0 * i / options.frames;
    const std::string name = frame_name("rotation", i);
    series.lights.push_back({name, file, [=] { return project(name, environment, turn); }});
  }
}

void add_day(const RelightOptions& options, const Projection& project, LightSeries& series) {
  options.sky.check();
  for (int i = 0; i < options.frames; ++i) {
    const std::string name = frame_name("day", i);
    const double done = options.frames == 1 ? 0.5 : static_cast<double>(i) / (options.frames - 1);
    series.lights.push_back({name, std::nullopt, [=, sky = options.sky, turn = options.turn] {
                               return project(name, prepared(clear_sky(sun_direction(done, sky), sky)), turn);
                             }});
  }
}

/// Light adds up, so maps are put onto the light map once, and their lights mixed.
void add_fade(const RelightOptions& options, const Projection& project, LightSeries& series) {
  const auto files = expand_globs(options.environments);
  if (files.size() < 2)
    throw InputError("--frames requires a motion; give several maps of --env, --rotate or --turntable");
  const auto lights = std::make_shared<std::vector<LightMap>>();
  Progress progress(run_context(), "projecting maps", files.size());
  for (const fs::path& file : files) {
    lights->push_back(project.light_map(
        file.stem().string(), PreparedEnvironment(read_environment(file, run_context()), run_context()),
        options.turn));
    progress.advance();
  }
  for (int i = 0; i < options.frames; ++i) {
    const double last = static_cast<double>(files.size()) - 1.0;
    const double place = options.frames == 1 ? 0.0 : last * i / (options.frames - 1);
    const auto from = std::min(static_cast<std::size_t>(place), files.size() - 2);
    series.lights.push_back(
        {frame_name("fade", i), files[from],
         [=] { return mixed((*lights)[from], (*lights)[from + 1], place - static_cast<double>(from)); }});
  }
}

/// Maps, turning maps, fades from map to map, days.
LightSeries environment_series(const RelightOptions& options, const ReflectanceField& field) {
  const Projection project = projection_of(options, field);
  LightSeries series{.is_sequence = options.rotate || options.fades() || options.day, .seen = project.seen};
  if (options.day)
    add_day(options, project, series);
  else if (options.fades())
    add_fade(options, project, series);
  else if (options.rotate)
    add_rotation(options, project, series);
  else
    add_maps(options, project, series);
  return series;
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

LightSeries light_series(const RelightOptions& options, const ReflectanceField& field) {
  check(options);
  const LightDomain& domain = field.basis.domain;
  if (options.bar > 0.0) return series_of_bar(options, domain);
  if (!options.area_lights.empty()) return series_of_area_lights(options, field);
  const bool is_environment = options.day || !options.environments.empty();
  LightSeries series = is_environment   ? environment_series(options, field)
                       : options.rotate ? series_of_rotated_light(options, domain)
                                        : series_of_lights(options, domain);
  if (options.camera.turntable && !series.is_sequence) hold_still(series, options.frames);
  return series;
}

}  // namespace refield::cli
