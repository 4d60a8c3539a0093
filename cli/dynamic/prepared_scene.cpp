// SPDX-License-Identifier: Apache-2.0
#include "cli/dynamic/prepared_scene.h"

#include "relight/mesh/mesh_view.h"

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

}  // namespace

PreparedScene::PreparedScene(dynamic::DynamicScene scene, const dynamic::TransportOptions& options,
                             const RunContext& run)
    : scene_(std::move(scene)) {
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
  Mesh mesh = joined_mesh(scene_, poses_);
  append_area_lights(area_lights_, mesh);
  return mesh;
}

std::vector<Eigen::Array3f> PreparedScene::radiance(int first_bounce, int last_bounce) {
  std::vector<Eigen::Array3f> radiance = light_->radiance(first_bounce, last_bounce);
  radiance.insert(radiance.end(), area_lights_.colours.begin(), area_lights_.colours.end());
  return radiance;
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

PinholeCamera camera_of(const dynamic::DynamicScene& scene) {
  const PinholeCamera standard;
  return scene.camera ? *scene.camera
                      : framing_camera(joined_mesh(scene, scene.poses(0.0)), standard.width, standard.height);
}

}  // namespace refield::cli
