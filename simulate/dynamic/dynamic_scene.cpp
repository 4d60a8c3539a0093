// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/dynamic_scene.h"

#include <algorithm>
#include <memory>
#include <span>
#include <string>

#include "core/base/config_file.h"
#include "simulate/dynamic/point_lights.h"
#include "simulate/geometry/place_mesh.h"
#include "simulate/geometry/scene_description.h"

namespace refield::dynamic {

namespace fs = std::filesystem;

namespace {

Brdf brdf_of(const MaterialDescription& material, const fs::path& folder) {
  Brdf brdf;
  brdf.diffuse = material.colour;
  brdf.specular = material.specular;
  switch (material.kind) {
    case MaterialDescription::Kind::phong:
      brdf.lobe = Lobe::phong;
      brdf.exponent = static_cast<float>(material.exponent);
      break;
    case MaterialDescription::Kind::ggx:
      brdf.lobe = Lobe::ggx;
      brdf.roughness = static_cast<float>(material.roughness * material.roughness);
      break;
    case MaterialDescription::Kind::measured:
      brdf.lobe = Lobe::table;
      brdf.table = std::make_shared<BrdfTable>(read_brdf_table(folder / material.file));
      break;
    default:
      break;
  }
  return brdf;
}

MovingObject read_moving_object(ConfigSection& section, std::span<const MaterialDescription> materials,
                                const fs::path& folder, std::size_t number, const RunContext& run) {
  MovingObject object;
  object.name = "object " + std::to_string(number);
  section.text("name", object.name);
  SceneObject described = read_scene_object(section, SceneKind::dynamic, materials, folder, run);
  object.brdf = brdf_of(described.material, folder);
  object.mesh = std::move(described.mesh);
  const Eigen::Vector3f middle = bounding_ball(object.mesh).middle;
  for (auto& position : object.mesh.positions) position -= middle;
  object.motion = read_motion(section, middle, true);
  section.finish();
  return object;
}

}  // namespace

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
  const ConfigFile file(path, "dynamic scene", "docs/reference/scene-files.md");
  file.check_names({"camera", "material", "object", "light"});
  const std::vector<MaterialDescription> materials = read_materials(file, SceneKind::dynamic);
  const fs::path folder = path.parent_path();
  DynamicScene scene;
  std::size_t triangles = 0;
  for (ConfigSection& section : file.sections("object")) {
    scene.objects.push_back(read_moving_object(section, materials, folder, scene.objects.size(), run));
    triangles += scene.objects.back().mesh.triangles.size();
    check_triangle_count(path, triangles);
  }
  for (ConfigSection& section : file.sections("light"))
    scene.lights.lights.push_back(prt::read_area_light(section, folder, run));
  if (file.has("camera")) scene.camera = read_camera(file.section("camera")).pinhole();
  return scene;
}

Mesh joined_mesh(const DynamicScene& scene, std::span<const Pose> poses) {
  Mesh all;
  for (std::size_t o = 0; o < scene.objects.size(); ++o) prt::append(scene.objects[o].mesh, poses[o], all);
  return all;
}

}  // namespace refield::dynamic
