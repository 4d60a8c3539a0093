// SPDX-License-Identifier: Apache-2.0

#include "cli/common/options.h"
#include "cli/dynamic/prepared_scene.h"
#include "cli/run_context.h"
#include "cli/verbs.h"
#include "relight/viewer/viewer.h"

namespace refield::cli {

namespace {

struct ViewOptions {
  WindowOptions window;
  fs::path shown;
  std::string light, size;
  std::vector<std::string> placements;
};

Eigen::Isometry3f handled(Eigen::Isometry3f pose, const Handling& handling) {
  const auto radians = static_cast<float>(handling.turn_degrees * std::numbers::pi / 180.0);
  pose.linear() = Eigen::AngleAxisf(radians, Eigen::Vector3f::UnitY()) * pose.linear();
  pose.translation() += handling.shift;
  return pose;
}

/// An area light that looks at a point still does where a hand took it.
Mesh handled_area_lights(const prt::AreaLights& lights, double time, std::span<const Handling> handling) {
  Mesh all;
  for (std::size_t i = 0; i < lights.lights.size(); ++i) {
    const prt::AreaLight& light = lights.lights[i];
    Mesh shape = light.shape;
    for (Eigen::Array3f& colour : shape.colours) colour *= static_cast<float>(handling[i].gain);
    Eigen::Isometry3f pose = light.pose(light.motion.position(time) + handling[i].shift);
    if (!light.towards) pose = handled(pose, {.turn_degrees = handling[i].turn_degrees});
    prt::append(shape, pose, all);
  }
  return all;
}

void light_moment(PreparedScene& prepared, const SceneMoment& moment, SceneFrame& frame) {
  const dynamic::DynamicScene& scene = prepared.scene();
  const std::size_t objects = scene.objects.size();
  std::vector<dynamic::Pose> poses = scene.poses(moment.time);
  for (std::size_t o = 0; o < objects; ++o) poses[o] = handled(poses[o], moment.handling[o]);
  PinholeCamera camera;
  camera.position = moment.eye;
  dynamic::FrameOptions options;
  options.bounces = moment.bounces;
  prepared.solve(std::move(poses),
                 handled_area_lights(scene.lights, moment.time, moment.handling.subspan(objects)), camera,
                 options);
  frame.mesh = prepared.mesh();
  frame.radiance = prepared.radiance(0, prepared.light().bounces());
}

SceneThing thing_of(const dynamic::MovingObject& object) {
  return {.name = object.name, .moves = object.motion.duration() > 0.0, .can_turn = true};
}

SceneThing thing_of(const prt::AreaLight& light, std::size_t number, std::size_t count) {
  return {.name = count == 1 ? "area light" : "area light " + std::to_string(number + 1),
          .is_area_light = true,
          .moves = light.motion.path.size() > 1,
          .can_turn = !light.towards};
}

/// A description of a moving scene (TOML, docs/reference/scene-files.md) with all that is precomputed. Throws
/// what read_dynamic_scene() throws, and Interrupted.
MovingScene read_moving_scene(const fs::path& path) {
  const auto prepared = std::make_shared<PreparedScene>(dynamic::read_dynamic_scene(path, run_context()),
                                                        dynamic::TransportOptions{}, run_context());
  const dynamic::DynamicScene& scene = prepared->scene();
  const std::vector<prt::AreaLight>& lights = scene.lights.lights;
  MovingScene moving;
  moving.name = path.filename().string();
  moving.duration = scene.duration();
  moving.camera = camera_of(scene);
  std::vector<std::uint32_t> first = {0};
  for (const dynamic::MovingObject& object : scene.objects) {
    moving.things.push_back(thing_of(object));
    first.push_back(first.back() + static_cast<std::uint32_t>(object.mesh.positions.size()));
  }
  for (std::size_t i = 0; i < lights.size(); ++i) {
    moving.things.push_back(thing_of(lights[i], i, lights.size()));
    first.push_back(first.back() + static_cast<std::uint32_t>(lights[i].shape.positions.size()));
  }
  moving.middle = [prepared](std::size_t thing, double time) -> Eigen::Vector3f {
    const dynamic::DynamicScene& described = prepared->scene();
    const std::size_t objects = described.objects.size();
    return thing < objects ? described.objects[thing].motion.at(time).translation()
                           : described.lights.lights[thing - objects].motion.position(time);
  };
  moving.light = [prepared, first](const SceneMoment& moment, SceneFrame& frame) {
    light_moment(*prepared, moment, frame);
    frame.first_vertex = first;
  };
  return moving;
}

void view(ViewOptions& options, const Common& /*common*/) {
  WindowOptions& window = options.window;
  if (!options.placements.empty()) window.monitors = placements_from_texts(options.placements);
  if (!options.size.empty()) {
    const PictureSize size = read_picture_size(options.size, {720, 520});
    window.width = size.width;
    window.height = size.height;
  }
  const bool moves = options.shown.extension() == ".toml";
  if (moves && !options.placements.empty())
    throw InputError(
        "--placement: a dynamic scene has no monitor; it is supported for fields (.rfield) only");
  if (moves && !options.light.empty())
    throw InputError("--light ", options.light, ": a dynamic scene defines its area lights in ",
                     options.shown, "; light maps are supported for fields (.rfield) only");
  if (moves)
    return run_scene_viewer(
        options.shown.filename().string(), [&] { return read_moving_scene(options.shown); }, options.window,
        run_context());
  const auto light = options.light.empty() ? std::nullopt : std::optional<fs::path>(options.light);
  run_viewer(options.shown, light, options.window, run_context());
}

}  // namespace

void add_view(CLI::App& app, const Common& common, Action& action) {
  const auto options = std::make_shared<ViewOptions>();
  CLI::App* verb = app.add_subcommand(
      "view",
      "Relight a field or a dynamic scene in an interactive viewer.\n"
      "\n"
      "Fields: drag area lights over the light map to relight the scene; click a pixel to see which light "
      "reaches it; hold the right mouse button on the light map to see the contribution of that region. Drop "
      "light maps and fields onto the window to open them.\n"
      "\n"
      "Dynamic scenes: drag objects and area lights; Space plays the motion of the scene.\n"
      "\n"
      "F1 lists all keys.\n"
      "\n"
      "Examples:\n"
      "  refield view scene.rfield --light sky.exr\n"
      "  refield view datasets_synthetic/dynamic/room.toml");
  verb->add_option(
          "file", options->shown,
          "File: reflectance field (.rfield) or dynamic scene (.toml, docs/reference/scene-files.md)")
      ->required();
  verb->add_option("--light", options->light,
                   "Light maps: the file shown at first (EXR, HDR: linear; PNG, JPEG: sRGB; default: white)");
  add_placement_option(*verb, options->placements,
                       "Environment maps are seen through it (default: that of the field).");
  verb->add_option("--size", options->size, "Size of the picture in pixels (default: 1440x900)")
      ->type_name("WIDTHxHEIGHT");
  on_command(*verb, options, common, action, view);
}

}  // namespace refield::cli
