// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/dynamic_scene.h"

#include <algorithm>

#include "core/base/config_file.h"
#include "core/base/errors.h"
#include "simulate/dynamic/point_lights.h"
#include "simulate/geometry/mesh_section.h"
#include "simulate/geometry/mesh_shapes.h"
#include "simulate/geometry/place_mesh.h"

namespace refield::dynamic {

namespace fs = std::filesystem;

namespace {

Brdf read_brdf(ConfigSection& section, const fs::path& folder) {
  Brdf brdf;
  brdf.diffuse = prt::read_vector(section, "diffuse", brdf.diffuse.matrix(), 0.0, 1.0).array();
  brdf.specular = prt::read_vector(section, "specular", brdf.specular.matrix(), 0.0, 1.0).array();
  std::string table;
  section.text("brdf", table);
  const int lobes = section.has("exponent") + section.has("roughness") + section.has("brdf");
  if (lobes > 1)
    section.fail("brdf", "give one of `exponent` (Phong), `roughness` (GGX) and `brdf` (a table)");
  if (section.has("exponent")) brdf.lobe = Lobe::phong;
  if (section.has("roughness")) brdf.lobe = Lobe::ggx;
  if (section.has("brdf")) {
    brdf.lobe = Lobe::table;
    brdf.table = std::make_shared<BrdfTable>(read_brdf_table(folder / table));
    if (!section.has("diffuse")) brdf.diffuse.setZero();
    if (!section.has("specular")) brdf.specular.setOnes();
  }
  brdf.exponent = prt::read_number(section, "exponent", 0.0f, 1.0, 1e5);
  brdf.roughness = prt::read_number(section, "roughness", 1.0f, 0.01, 1.0);
  const bool shines = (brdf.specular > 0.0f).any();
  if (shines != (brdf.lobe != Lobe::none))
    section.fail("specular",
                 "requires one of `exponent` (Phong) and `roughness` (GGX), which in turn require it");
  if (brdf.lobe == Lobe::phong && (brdf.diffuse + brdf.specular > 1.0f).any())
    section.fail("specular", "with `diffuse` it must not add up to more than 1");
  return brdf;
}

Motion read_motion(ConfigSection& section, const Eigen::Vector3f& middle) {
  Motion motion;
  motion.path = {{0.0, middle}};
  const auto ascending = [&](const char* key, const std::vector<std::vector<double>>& rows) {
    for (std::size_t i = 0; i < rows.size(); ++i)
      if (rows[i][0] < 0.0 || (i > 0 && rows[i][0] <= rows[i - 1][0]))
        section.fail(key, "times must ascend from 0 or later");
    if (rows.empty()) section.fail(key, "give at least one keyframe");
  };
  if (section.has("path")) {
    const auto rows = section.rows("path", 4, "give keyframes [seconds, x, y, z] of the centre");
    ascending("path", rows);
    motion.path.clear();
    for (const auto& stop : rows)
      motion.path.push_back({stop[0], Eigen::Vector3d(stop[1], stop[2], stop[3]).cast<float>()});
  }
  if (section.has("turns")) {
    const auto rows = section.rows("turns", 4, "give keyframes [seconds, yaw, pitch, roll] in degrees");
    ascending("turns", rows);
    for (const auto& stop : rows)
      motion.turns.push_back({stop[0], {.yaw = stop[1], .pitch = stop[2], .roll = stop[3]}});
  }
  return motion;
}

MovingObject read_object(ConfigSection& section, const fs::path& folder, std::size_t number,
                         const RunContext& run) {
  MovingObject object;
  object.name = "object " + std::to_string(number);
  section.text("name", object.name);
  object.brdf = read_brdf(section, folder);
  object.mesh = prt::read_mesh(section, folder, run);
  const Eigen::Vector3f middle = bounding_ball(object.mesh).middle;
  for (auto& position : object.mesh.positions) position -= middle;
  object.motion = read_motion(section, middle);
  section.finish();
  return object;
}

/// The stop after which `time` lies, the next one, and how far it is on the way; both the same at the ends.
template <class Stop>
struct Way {
  const Stop *before, *after;
  double share;
};
template <class Stop>
Way<Stop> way_at(const std::vector<Stop>& stops, double time) {
  const auto next = std::ranges::find_if(stops, [time](const Stop& stop) { return stop.time > time; });
  if (next == stops.begin()) return {&stops.front(), &stops.front(), 0.0};
  if (next == stops.end()) return {&stops.back(), &stops.back(), 0.0};
  const Stop& last = *(next - 1);
  return {&last, &*next, (time - last.time) / (next->time - last.time)};
}

}  // namespace

Pose Motion::at(double time) const {
  Pose pose = Pose::Identity();
  const auto way = way_at(path, time);
  pose.translation() =
      way.before->position + static_cast<float>(way.share) * (way.after->position - way.before->position);
  if (turns.empty()) return pose;
  const auto [before, after, share] = way_at(turns, time);
  const EulerAngles &a = before->turn, &b = after->turn;
  const EulerAngles turn = {.yaw = a.yaw + share * (b.yaw - a.yaw),
                            .pitch = a.pitch + share * (b.pitch - a.pitch),
                            .roll = a.roll + share * (b.roll - a.roll)};
  pose.linear() = turn.matrix().cast<float>();
  return pose;
}

double Motion::duration() const {
  return std::max(path.back().time, turns.empty() ? 0.0 : turns.back().time);
}

double DynamicScene::duration() const {
  double duration = lights.duration();
  for (const MovingObject& object : objects) duration = std::max(duration, object.motion.duration());
  return duration;
}

std::vector<Pose> DynamicScene::poses(double time) const {
  std::vector<Pose> poses;
  for (const MovingObject& object : objects) poses.push_back(object.motion.at(time));
  return poses;
}

DynamicScene read_dynamic_scene(const fs::path& path, const RunContext& run) {
  const ConfigFile file(path, "dynamic scene", "docs/reference/mesh-scenes.md");
  file.check_names({"camera", "object", "light"});
  DynamicScene scene;
  std::size_t triangles = 0;
  for (ConfigSection& section : file.sections("object")) {
    scene.objects.push_back(read_object(section, path.parent_path(), scene.objects.size(), run));
    triangles += scene.objects.back().mesh.triangles.size();
    if (triangles > prt::max_triangles)
      throw InputError(path.string() + ": the scene has more than " + std::to_string(prt::max_triangles) +
                       " triangles; simplify its meshes or refine them less");
  }
  for (ConfigSection& section : file.sections("light"))
    scene.lights.lights.push_back(prt::read_area_light(section, path.parent_path(), run));
  if (file.has("camera")) scene.camera = prt::read_camera(file.section("camera"));
  return scene;
}

Mesh joined_mesh(const DynamicScene& scene, std::span<const Pose> poses) {
  Mesh all;
  for (std::size_t o = 0; o < scene.objects.size(); ++o) prt::append(scene.objects[o].mesh, poses[o], all);
  return all;
}

}  // namespace refield::dynamic
