// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/dynamic_scene.h"

#include <algorithm>

#include "core/base/config_file.h"
#include "simulate/geometry/place_mesh.h"
#include "simulate/geometry/scene_description.h"

namespace refield::dynamic {

namespace {

Brdf brdf_of(const MaterialDescription& material) {
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
    default:
      break;
  }
  return brdf;
}

/// An object has one BRDF, times the colours of its vertices. The lobes of a mesh file join its colours,
/// which become the whole reflectance at each vertex; its shares for diffuse reflection and lobe are the
/// means over the surface, and so is the roughness, weighted by the lobe's reflectance.
Brdf average_lobes(Mesh& mesh, std::span<const Eigen::Array4f> lobes, const std::string& name,
                   const RunContext& run) {
  const std::vector<float> areas = prt::vertex_areas(mesh.positions, mesh.triangles);
  Eigen::Array3f diffuse = Eigen::Array3f::Zero(), specular = Eigen::Array3f::Zero();
  float roughness = 0.0f;
  for (std::size_t v = 0; v < lobes.size(); ++v) {
    const Eigen::Array3f lobe = areas[v] * lobes[v].head<3>();
    diffuse += areas[v] * mesh.colours[v];
    specular += lobe;
    roughness += lobe.sum() * lobes[v][3];
    mesh.colours[v] += lobes[v].head<3>();
  }
  const Eigen::Array3f all = (diffuse + specular).max(std::numeric_limits<float>::min());
  Brdf brdf;
  brdf.lobe = Lobe::ggx;
  brdf.diffuse = diffuse / all;
  brdf.specular = specular / all;
  roughness = specular.sum() > 0.0f ? roughness / specular.sum() : 1.0f;
  brdf.roughness = roughness * roughness;
  constexpr float seen = 0.05f;  // of the reflectance
  bool differs = false;
  for (std::size_t v = 0; v < lobes.size() && !differs; ++v) {
    const Eigen::Array3f mean = brdf.specular * mesh.colours[v];
    differs = ((lobes[v].head<3>() - mean).abs() > seen).any() || std::abs(lobes[v][3] - roughness) > seen;
  }
  if (differs)
    run.note(name,
             ": an object of a dynamic scene has one lobe, so the metallic and roughness values of its "
             "mesh file are averaged; divide the file by material to keep them");
  return brdf;
}

MovingObject read_moving_object(ConfigSection& section, std::span<const MaterialDescription> materials,
                                const fs::path& folder, std::size_t number, const RunContext& run) {
  MovingObject object;
  object.name = "object " + std::to_string(number);
  section.text("name", object.name);
  SceneObject described =
      read_scene_object(section, SceneKind::dynamic, materials, folder, prt::Gloss::lobes, run);
  object.mesh = std::move(described.mesh);
  object.brdf = described.lobes.empty() ? brdf_of(described.material)
                                        : average_lobes(object.mesh, described.lobes, object.name, run);
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

BoundingBall bounding_ball(const Mesh& mesh) {
  BoundingBall ball{prt::bounds_of(mesh).center(), 0.0f};
  for (const auto& position : mesh.positions)
    ball.radius = std::max(ball.radius, (position - ball.middle).norm());
  return ball;
}

Mesh joined_mesh(const DynamicScene& scene, std::span<const Pose> poses) {
  Mesh all;
  for (std::size_t o = 0; o < scene.objects.size(); ++o) prt::append(scene.objects[o].mesh, poses[o], all);
  return all;
}

SceneRays::SceneRays(std::span<const prt::MeshRays> objects)
    : objects_(objects), poses_(objects.size()), scene_(prt::RayScene::Use::moving) {
  for (const prt::MeshRays& object : objects) scene_.add_instance(object.scene());
  move(std::vector<Pose>(objects.size(), Pose::Identity()));
}

void SceneRays::move(std::span<const Pose> poses) {
  for (std::uint32_t i = 0; i < objects_.size(); ++i) scene_.set_pose(i, poses_[i] = poses[i]);
  scene_.commit();
}

std::uint32_t SceneRays::unoccluded(std::span<const Eigen::Vector3f> points,
                                    std::span<const Eigen::Vector3f> directions,
                                    std::span<const float> distance) const {
  return scene_.unoccluded(points, directions, distance, false);
}

SceneHit SceneRays::hit_on_object(const prt::FirstHit& hit, const Eigen::Vector3f& direction) const {
  const Eigen::Vector3f own_direction = poses_[hit.instance].linear().transpose() * direction;
  return {hit.instance, prt::mesh_hit(objects_[hit.instance].mesh(), hit, own_direction)};
}

void SceneRays::intersect(std::span<const Eigen::Vector3f> origins,
                          std::span<const Eigen::Vector3f> directions,
                          std::span<std::optional<SceneHit>> hits) const {
  std::array<std::optional<prt::FirstHit>, prt::ray_packet> first;
  scene_.first_hits(origins, directions, first);
  for (std::size_t i = 0; i < origins.size(); ++i) {
    hits[i].reset();
    if (first[i]) hits[i] = hit_on_object(*first[i], directions[i]);
  }
}

std::vector<Eigen::Vector3f> ray_starts(const Mesh& mesh) {
  constexpr float share = 0.01f;
  const std::size_t vertices = mesh.positions.size();
  std::vector<Eigen::Vector3f> sums(vertices, Eigen::Vector3f::Zero());
  std::vector<float> count(vertices, 0.0f);
  for (const auto& triangle : mesh.triangles)
    for (const std::uint32_t v : triangle) {
      for (const std::uint32_t other : triangle)
        sums[v] += (mesh.positions[other] - mesh.positions[v]) / 3.0f;
      count[v] += 1.0f;
    }
  for (std::size_t v = 0; v < vertices; ++v) {
    const Eigen::Vector3f inwards = sums[v] / std::max(count[v], 1.0f);
    sums[v] = mesh.positions[v] + share * (inwards - inwards.dot(mesh.normals[v]) * mesh.normals[v]);
  }
  return sums;
}

}  // namespace refield::dynamic
