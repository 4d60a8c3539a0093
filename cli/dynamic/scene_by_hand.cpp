// SPDX-License-Identifier: Apache-2.0
#include "cli/dynamic/scene_by_hand.h"

#include <memory>
#include <numbers>

#include "cli/dynamic/prepared_scene.h"
#include "cli/run_context.h"
#include "simulate/prt/place_mesh.h"

namespace refield::cli {

namespace {

Eigen::Isometry3f handled(Eigen::Isometry3f pose, const Handling& handling) {
  const auto radians = static_cast<float>(handling.turn_degrees * std::numbers::pi / 180.0);
  pose.linear() = Eigen::AngleAxisf(radians, Eigen::Vector3f::UnitY()) * pose.linear();
  pose.translation() += handling.shift;
  return pose;
}

/// A lamp that looks at a point still does where a hand took it.
Mesh handled_lamps(const prt::AreaLights& lights, double time, std::span<const Handling> handling) {
  Mesh all;
  for (std::size_t i = 0; i < lights.lights.size(); ++i) {
    const prt::AreaLight& light = lights.lights[i];
    Mesh shape = light.shape;
    for (Eigen::Array3f& colour : shape.colours) colour *= static_cast<float>(handling[i].gain);
    Eigen::Isometry3f pose = light.pose(light.position(time) + handling[i].shift);
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
  prepared.solve(std::move(poses), handled_lamps(scene.lights, moment.time, moment.handling.subspan(objects)),
                 camera, options);
  frame.mesh = prepared.mesh();
  frame.radiance = prepared.radiance(0, prepared.light().bounces());
}

SceneThing thing_of(const dynamic::MovingObject& object) {
  return {.name = object.name, .moves = object.motion.duration() > 0.0, .can_turn = true};
}

SceneThing thing_of(const prt::AreaLight& light, std::size_t number, std::size_t count) {
  return {.name = count == 1 ? "lamp" : "lamp " + std::to_string(number + 1),
          .is_lamp = true,
          .moves = light.path.size() > 1,
          .can_turn = !light.towards};
}

}  // namespace

MovingScene read_moving_scene(const std::filesystem::path& path) {
  const auto prepared = std::make_shared<PreparedScene>(dynamic::read_dynamic_scene(path, run_context()),
                                                        dynamic::TransportOptions{},
                                                        dynamic::TransportCache::from_environment());
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
                           : described.lights.lights[thing - objects].position(time);
  };
  moving.light = [prepared, first](const SceneMoment& moment, SceneFrame& frame) {
    light_moment(*prepared, moment, frame);
    frame.first_vertex = first;
  };
  return moving;
}

}  // namespace refield::cli
