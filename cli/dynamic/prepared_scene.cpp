// SPDX-License-Identifier: Apache-2.0
#include "cli/dynamic/prepared_scene.h"

#include <memory>

#include "relight/mesh/mesh_view.h"
#include "simulate/geometry/place_mesh.h"

namespace refield::cli {

namespace {

/// Area lights, too: their vertices' radiance follows the objects'.
void append_area_lights(const Mesh& area_lights, Mesh& all) {
  const auto first = static_cast<std::uint32_t>(all.positions.size());
  all.positions.insert(all.positions.end(), area_lights.positions.begin(), area_lights.positions.end());
  all.normals.insert(all.normals.end(), area_lights.normals.begin(), area_lights.normals.end());
  for (const auto& [a, b, c] : area_lights.triangles) {
    all.triangles.push_back({first + a, first + b, first + c});
    all.triangles.push_back({first + a, first + c, first + b});  // both sides shine
  }
}

/// Objects in their places and area lights after them.
Mesh mesh_with_area_lights(const dynamic::DynamicScene& scene, std::span<const dynamic::Pose> poses,
                           const Mesh& area_lights) {
  Mesh mesh = joined_mesh(scene, poses);
  append_area_lights(area_lights, mesh);
  return mesh;
}

/// Of its vertices; `radiance`: of the objects'.
std::vector<Eigen::Array3f> radiance_with_area_lights(std::vector<Eigen::Array3f> radiance,
                                                      const Mesh& area_lights) {
  radiance.insert(radiance.end(), area_lights.colours.begin(), area_lights.colours.end());
  return radiance;
}

constexpr int reference_area_light_points = 4096;

}  // namespace

PreparedScene::PreparedScene(dynamic::DynamicScene scene, const dynamic::TransportOptions& options,
                             const RunContext& run)
    : run_(run), scene_(std::move(scene)) {
  rays_.reserve(scene_.objects.size());
  for (const dynamic::MovingObject& object : scene_.objects) {
    rays_.emplace_back(object.mesh);
    transport_.push_back(dynamic::object_transport(object, rays_.back(), options, run));
    run.throw_if_stopped();  // else it may be incomplete
  }
  light_ = std::make_unique<dynamic::DynamicLight>(scene_, rays_, transport_);
}

std::size_t PreparedScene::bytes() const {
  std::size_t bytes = 0;
  for (const auto& transport : transport_) bytes += transport.bytes();
  return bytes;
}

void PreparedScene::solve(double time, const PinholeCamera& camera, const dynamic::FrameOptions& options) {
  solve(scene_.poses(time), scene_.lights.at(time), camera, options);
}

void PreparedScene::solve(std::vector<dynamic::Pose> poses, Mesh area_lights, const PinholeCamera& camera,
                          const dynamic::FrameOptions& options) {
  camera_ = camera;
  poses_ = std::move(poses);
  area_lights_ = std::move(area_lights);
  light_->solve(poses_, area_lights_, camera.position, options);
}

Mesh PreparedScene::mesh() const {
  return mesh_with_area_lights(scene_, poses_, area_lights_);
}

std::vector<Eigen::Array3f> PreparedScene::radiance(int first_bounce, int last_bounce) {
  return radiance_with_area_lights(light_->radiance(first_bounce, last_bounce), area_lights_);
}

Image PreparedScene::picture(int first_bounce, int last_bounce) {
  const Mesh all = mesh();
  return MeshRenderer(all, camera_).show(radiance(first_bounce, last_bounce));
}

Image PreparedScene::reflected_picture() {
  const Mesh all = mesh();
  std::vector<Eigen::Array3f> reflected = light_->radiance(0, light_->bounces());
  reflected.resize(all.positions.size(), Eigen::Array3f::Zero());
  return MeshRenderer(all, camera_).show(reflected);
}

Image PreparedScene::traced_picture(double time, const PinholeCamera& camera,
                                    const dynamic::ReferenceOptions& options) const {
  const std::vector<dynamic::Pose> poses = scene_.poses(time);
  std::vector<dynamic::PathStart> starts;
  for (std::uint32_t o = 0; o < scene_.objects.size(); ++o)
    for (std::uint32_t v = 0; v < scene_.objects[o].mesh.positions.size(); ++v)
      starts.push_back(path_start(scene_, poses, o, v, camera.position));
  std::vector<Eigen::Array3f> radiance(starts.size(), Eigen::Array3f::Zero());
  for (const auto& bounce : reference(time, starts, options))
    for (std::size_t v = 0; v < radiance.size(); ++v) radiance[v] += bounce[v];
  const Mesh area_lights = scene_.lights.at(time);
  const Mesh all = mesh_with_area_lights(scene_, poses, area_lights);
  return MeshRenderer(all, camera).show(radiance_with_area_lights(std::move(radiance), area_lights));
}

std::vector<std::vector<Eigen::Array3f>> PreparedScene::reference(
    double time, std::span<const dynamic::PathStart> starts, const dynamic::ReferenceOptions& options) const {
  const std::vector<dynamic::Pose> poses = scene_.poses(time);
  dynamic::SceneRays rays(rays_);
  rays.move(poses);
  const auto area_lights = dynamic::area_points(scene_.lights.at(time), reference_area_light_points);
  return trace_bounces(scene_, rays, poses, {.area_lights = area_lights}, starts, options, run_);
}

PinholeCamera camera_of(const dynamic::DynamicScene& scene) {
  const PinholeCamera standard;
  return scene.camera ? *scene.camera
                      : framing_camera(joined_mesh(scene, scene.poses(0.0)), standard.width, standard.height);
}

}  // namespace refield::cli
