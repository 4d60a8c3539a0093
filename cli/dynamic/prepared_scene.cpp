// SPDX-License-Identifier: Apache-2.0
#include "cli/dynamic/prepared_scene.h"

#include "cli/run_context.h"
#include "relight/mesh_view.h"

namespace refield::cli {

namespace {

/// Lamps, too: their vertices' radiance follows the objects'.
void append_lamps(const Mesh& lamps, Mesh& all) {
  const auto first = static_cast<std::uint32_t>(all.positions.size());
  all.positions.insert(all.positions.end(), lamps.positions.begin(), lamps.positions.end());
  all.normals.insert(all.normals.end(), lamps.normals.begin(), lamps.normals.end());
  for (const auto& [a, b, c] : lamps.triangles) {
    all.triangles.push_back({first + a, first + b, first + c});
    all.triangles.push_back({first + a, first + c, first + b});  // both sides shine
  }
}

/// Objects in their places and lamps after them.
Mesh mesh_with_lamps(const dynamic::DynamicScene& scene, std::span<const dynamic::Pose> poses,
                     const Mesh& lamps) {
  Mesh mesh = joined_mesh(scene, poses);
  append_lamps(lamps, mesh);
  return mesh;
}

/// Of its vertices; `radiance`: of the objects'.
std::vector<Eigen::Array3f> radiance_with_lamps(std::vector<Eigen::Array3f> radiance, const Mesh& lamps) {
  radiance.insert(radiance.end(), lamps.colours.begin(), lamps.colours.end());
  return radiance;
}

constexpr int reference_lamp_points = 4096;

}  // namespace

PreparedScene::PreparedScene(dynamic::DynamicScene scene, const dynamic::TransportOptions& options,
                             const dynamic::TransportCache& cache)
    : scene_(std::move(scene)) {
  rays_.reserve(scene_.objects.size());
  for (const dynamic::MovingObject& object : scene_.objects) {
    rays_.emplace_back(object.mesh);
    if (auto stored = cache.load(object, options)) {
      transport_.push_back(*std::move(stored));
      ++cached_;
      continue;
    }
    transport_.push_back(dynamic::object_transport(object, rays_.back(), options, run_context()));
    run_context().throw_if_stopped();  // else it may be incomplete
    cache.store(object, options, transport_.back());
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

void PreparedScene::solve(std::vector<dynamic::Pose> poses, Mesh lamps, const PinholeCamera& camera,
                          const dynamic::FrameOptions& options) {
  camera_ = camera;
  poses_ = std::move(poses);
  lamps_ = std::move(lamps);
  light_->solve(poses_, lamps_, camera.position, options);
}

Mesh PreparedScene::mesh() const {
  return mesh_with_lamps(scene_, poses_, lamps_);
}

std::vector<Eigen::Array3f> PreparedScene::radiance(int first_bounce, int last_bounce) {
  return radiance_with_lamps(light_->radiance(first_bounce, last_bounce), lamps_);
}

Image PreparedScene::picture(int first_bounce, int last_bounce) {
  const Mesh all = mesh();
  return MeshView(all, camera_).show(radiance(first_bounce, last_bounce));
}

Image PreparedScene::reflected_picture() {
  const Mesh all = mesh();
  std::vector<Eigen::Array3f> reflected = light_->radiance(0, light_->bounces());
  reflected.resize(all.positions.size(), Eigen::Array3f::Zero());
  return MeshView(all, camera_).show(reflected);
}

Image PreparedScene::traced_picture(double time, const PinholeCamera& camera,
                                    const dynamic::ReferenceOptions& options) const {
  std::vector<dynamic::VertexOf> vertices;
  for (std::uint32_t o = 0; o < scene_.objects.size(); ++o)
    for (std::uint32_t v = 0; v < scene_.objects[o].mesh.positions.size(); ++v) vertices.push_back({o, v});
  std::vector<Eigen::Array3f> radiance(vertices.size(), Eigen::Array3f::Zero());
  for (const auto& bounce : reference(time, vertices, camera.position, options))
    for (std::size_t v = 0; v < radiance.size(); ++v) radiance[v] += bounce[v];
  const Mesh lamps = scene_.lights.at(time);
  const Mesh all = mesh_with_lamps(scene_, scene_.poses(time), lamps);
  return MeshView(all, camera).show(radiance_with_lamps(std::move(radiance), lamps));
}

std::vector<std::vector<Eigen::Array3f>> PreparedScene::reference(
    double time, std::span<const dynamic::VertexOf> vertices, const Eigen::Vector3f& eye,
    const dynamic::ReferenceOptions& options) const {
  const std::vector<dynamic::Pose> poses = scene_.poses(time);
  dynamic::SceneRays rays(rays_);
  rays.move(poses);
  const auto lamps = dynamic::area_points(scene_.lights.at(time), reference_lamp_points);
  return trace_bounces(scene_, rays, poses, lamps, vertices, eye, options, run_context());
}

PinholeCamera camera_of(const dynamic::DynamicScene& scene) {
  const PinholeCamera standard;
  return scene.camera ? *scene.camera
                      : framing_camera(joined_mesh(scene, scene.poses(0.0)), standard.width, standard.height);
}

}  // namespace refield::cli
