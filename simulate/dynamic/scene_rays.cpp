// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/scene_rays.h"

#include <embree3/rtcore.h>

#include "simulate/geometry/embree_device.h"

namespace refield::dynamic {

void SceneRays::Release::operator()(RTCSceneTy* scene) const {
  rtcReleaseScene(scene);
}

void SceneRays::Release::operator()(RTCGeometryTy* geometry) const {
  rtcReleaseGeometry(geometry);
}

SceneRays::SceneRays(std::span<const prt::MeshRays> objects)
    : objects_(objects), poses_(objects.size(), Pose::Identity()), scene_(rtcNewScene(embree_device())) {
  rtcSetSceneFlags(scene_.get(), RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_DYNAMIC);
  for (const prt::MeshRays& object : objects) {
    RTCGeometry instance = rtcNewGeometry(embree_device(), RTC_GEOMETRY_TYPE_INSTANCE);
    instances_.emplace_back(instance);
    rtcSetGeometryInstancedScene(instance, object.embree_scene());
    rtcAttachGeometryByID(scene_.get(), instance, static_cast<unsigned>(instances_.size() - 1));
  }
  move(std::vector<Pose>(objects.size(), Pose::Identity()));
}

void SceneRays::move(std::span<const Pose> poses) {
  for (std::size_t i = 0; i < instances_.size(); ++i) {
    poses_[i] = poses[i];
    const Eigen::Matrix<float, 3, 4> columns = poses[i].affine();
    rtcSetGeometryTransform(instances_[i].get(), 0, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, columns.data());
    rtcCommitGeometry(instances_[i].get());
  }
  rtcCommitScene(scene_.get());
}

std::uint32_t SceneRays::unoccluded(std::span<const Eigen::Vector3f> points,
                                    std::span<const Eigen::Vector3f> directions,
                                    std::span<const float> distance) const {
  return prt::unoccluded(scene_.get(), points, directions, distance, false);
}

std::optional<SceneHit> SceneRays::intersect(const Eigen::Vector3f& origin,
                                             const Eigen::Vector3f& direction) const {
  const auto hit = prt::first_hit(scene_.get(), origin, direction);
  if (!hit) return std::nullopt;
  const Eigen::Vector3f own_direction = poses_[hit->instance].linear().transpose() * direction;
  return SceneHit{hit->instance, prt::mesh_hit(objects_[hit->instance].mesh(), *hit, own_direction)};
}

}  // namespace refield::dynamic
