// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/scene_rays.h"

#include <algorithm>
#include <array>

namespace refield::dynamic {

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

std::optional<SceneHit> SceneRays::intersect(const Eigen::Vector3f& origin,
                                             const Eigen::Vector3f& direction) const {
  const auto hit = scene_.first_hit(origin, direction);
  if (!hit) return std::nullopt;
  return hit_on_object(*hit, direction);
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
