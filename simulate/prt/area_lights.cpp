// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/area_lights.h"

#include <algorithm>

#include "core/base/config_file.h"
#include "simulate/geometry/place_mesh.h"
#include "simulate/geometry/scene_description.h"

namespace refield::prt {

namespace {

constexpr double brightest = 1e6;

/// Turns Y towards a unit direction. (Eigen's FromTwoVectors takes fifteen seconds to compile.)
Eigen::Quaternionf turn_of_y(const Eigen::Vector3f& direction) {
  constexpr float opposite = -0.999999f;
  if (direction.y() < opposite) return {0.0f, 1.0f, 0.0f, 0.0f};
  return Eigen::Quaternionf(1.0f + direction.y(), direction.z(), 0.0f, -direction.x()).normalized();
}

}  // namespace

Eigen::Isometry3f AreaLight::pose(const Eigen::Vector3f& position) const {
  Eigen::Isometry3f pose = Eigen::Isometry3f::Identity();
  pose.translation() = position;
  if (towards && *towards != position)
    pose.linear() = turn_of_y((*towards - position).normalized()).toRotationMatrix();
  return pose;
}

double AreaLights::duration() const {
  double duration = 0.0;
  for (const AreaLight& light : lights) duration = std::max(duration, light.motion.duration());
  return duration;
}

Mesh AreaLights::at(double time) const {
  Mesh all;
  for (const AreaLight& light : lights) append(light.shape, light.pose(light.motion.position(time)), all);
  return all;
}

AreaLight read_area_light(ConfigSection& section, const fs::path& folder, const RunContext& run) {
  AreaLight light;
  section.require("radiance");
  if (section.has("path") == section.has("position"))
    section.fail("path", "give either `position` or, for a moving light, `path`");
  light.motion = read_motion(section, read_vector(section, "position", Eigen::Vector3f::Zero()), false);
  light.shape = read_mesh(section, SceneKind::dynamic, folder, run);
  Placement centred;
  centred.position = Eigen::Vector3f::Zero();
  place(light.shape, centred);
  const Eigen::Array3f radiance =
      read_vector(section, "radiance", Eigen::Vector3f::Zero(), 0.0, brightest).array();
  for (Eigen::Array3f& colour : light.shape.colours) colour *= radiance;
  if (section.has("towards")) light.towards = read_vector(section, "towards", Eigen::Vector3f::Zero());
  section.finish();
  return light;
}

AreaLights read_area_lights(const fs::path& path, const RunContext& run) {
  const ConfigFile file(path, "lights", "docs/reference/scene-files.md");
  file.check_names({"light"});
  AreaLights lights;
  for (ConfigSection& section : file.sections("light"))
    lights.lights.push_back(read_area_light(section, path.parent_path(), run));
  return lights;
}

}  // namespace refield::prt
