// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/scene_rays.h"

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

std::optional<SceneHit> SceneRays::intersect(const Eigen::Vector3f& origin,
                                             const Eigen::Vector3f& direction) const {
  const auto hit = scene_.first_hit(origin, direction);
  if (!hit) return std::nullopt;
  const Eigen::Vector3f own_direction = poses_[hit->instance].linear().transpose() * direction;
  return SceneHit{hit->instance, prt::mesh_hit(objects_[hit->instance].mesh(), *hit, own_direction)};
}

}  // namespace refield::dynamic
