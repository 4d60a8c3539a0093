// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/area_lights.h"

#include <algorithm>

#include "core/base/config_file.h"
#include "simulate/geometry/mesh_section.h"
#include "simulate/geometry/place_mesh.h"

namespace refield::prt {

namespace {

constexpr double brightest = 1e6;

std::vector<AreaLight::Stop> read_path(ConfigSection& section) {
  const char* remedy = "give keyframes [seconds, x, y, z] with ascending times from 0 or later";
  std::vector<AreaLight::Stop> path;
  for (const auto& stop : section.rows("path", 4, remedy)) {
    if (stop[0] < 0.0 || (!path.empty() && stop[0] <= path.back().time)) section.fail("path", remedy);
    path.push_back({stop[0], Eigen::Vector3d(stop[1], stop[2], stop[3]).cast<float>()});
  }
  if (path.empty()) section.fail("path", remedy);
  return path;
}

}  // namespace

Eigen::Vector3f AreaLight::position(double time) const {
  const auto next = std::ranges::find_if(path, [time](const Stop& stop) { return stop.time > time; });
  if (next == path.begin()) return path.front().position;
  const Stop& last = *(next - 1);
  if (next == path.end()) return last.position;
  const auto share = static_cast<float>((time - last.time) / (next->time - last.time));
  return last.position + share * (next->position - last.position);
}

Eigen::Isometry3f AreaLight::pose(const Eigen::Vector3f& position) const {
  Eigen::Isometry3f pose = Eigen::Isometry3f::Identity();
  pose.translation() = position;
  if (towards && *towards != position)
    pose.linear() =
        Eigen::Quaternionf::FromTwoVectors(Eigen::Vector3f::UnitY(), *towards - position).toRotationMatrix();
  return pose;
}

double AreaLights::duration() const {
  double duration = 0.0;
  for (const AreaLight& light : lights) duration = std::max(duration, light.path.back().time);
  return duration;
}

Mesh AreaLights::at(double time) const {
  Mesh all;
  for (const AreaLight& light : lights) append(light.shape, light.pose(light.position(time)), all);
  return all;
}

AreaLight read_area_light(ConfigSection& section, const std::filesystem::path& folder,
                          const RunContext& run) {
  AreaLight light;
  section.require("radiance");
  if (section.has("path") == section.has("position"))
    section.fail("path", "give either `position` or, for a moving light, `path`");
  if (section.has("path"))
    light.path = read_path(section);
  else
    light.path = {{0.0, read_vector(section, "position", Eigen::Vector3f::Zero())}};
  light.shape = read_mesh(section, folder, run);
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

AreaLights read_area_lights(const std::filesystem::path& path, const RunContext& run) {
  const ConfigFile file(path, "lights", "docs/reference/mesh-scenes.md");
  file.check_names({"light"});
  AreaLights lights;
  for (ConfigSection& section : file.sections("light"))
    lights.lights.push_back(read_area_light(section, path.parent_path(), run));
  return lights;
}

}  // namespace refield::prt
