// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/mesh_rays.h"

#include <embree3/rtcore.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "simulate/embree_device.h"

namespace refield::prt {

namespace {

/// Rays start off their surface by so much of the scene's diagonal.
constexpr float offset_share = 2e-5f;

void fill_rays(RTCRayN* rays, unsigned count, std::span<const Eigen::Vector3f> points) {
  for (unsigned i = 0; i < count; ++i) {
    RTCRayN_org_x(rays, MeshRays::packet, i) = points[i].x();
    RTCRayN_org_y(rays, MeshRays::packet, i) = points[i].y();
    RTCRayN_org_z(rays, MeshRays::packet, i) = points[i].z();
    RTCRayN_tnear(rays, MeshRays::packet, i) = 0.0f;
    RTCRayN_time(rays, MeshRays::packet, i) = 0.0f;
    RTCRayN_mask(rays, MeshRays::packet, i) = ~0u;
    RTCRayN_flags(rays, MeshRays::packet, i) = 0;
  }
}

}  // namespace

struct MeshRays::Handles {
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;
  ~Handles() {
    if (scene) rtcReleaseScene(scene);
    if (device) rtcReleaseDevice(device);
  }

  /// Bit i: ray i of the packet met nothing.
  std::uint32_t unoccluded(RTCRay16& rays, unsigned count, bool coherent) const {
    alignas(64) int valid[packet];
    for (unsigned i = 0; i < packet; ++i) valid[i] = i < count ? -1 : 0;
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    if (coherent) context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
    rtcOccluded16(valid, scene, &context, &rays);
    std::uint32_t free = 0;
    for (unsigned i = 0; i < count; ++i) free |= static_cast<std::uint32_t>(rays.tfar[i] >= 0.0f) << i;
    return free;
  }
};

MeshRays::MeshRays(const Mesh& mesh) : mesh_(&mesh), handles_(std::make_unique<Handles>()) {
  Eigen::AlignedBox3f bounds;
  for (const auto& position : mesh.positions) bounds.extend(position);
  offset_ = bounds.isEmpty() ? 0.0f : offset_share * bounds.diagonal().norm();
  handles_->device = new_embree_device();
  handles_->scene = rtcNewScene(handles_->device);
  rtcSetSceneFlags(handles_->scene, RTC_SCENE_FLAG_ROBUST);
  RTCGeometry geometry = rtcNewGeometry(handles_->device, RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* positions = static_cast<float*>(
      rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float),
                              std::max<std::size_t>(mesh.positions.size(), 1)));
  for (const auto& position : mesh.positions) positions = std::copy_n(position.data(), 3, positions);
  auto* corners = static_cast<std::uint32_t*>(
      rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(std::uint32_t),
                              std::max<std::size_t>(mesh.triangles.size(), 1)));
  for (const auto& triangle : mesh.triangles) corners = std::copy_n(triangle.data(), 3, corners);
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(handles_->scene, geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(handles_->scene);
}

MeshRays::~MeshRays() = default;
MeshRays::MeshRays(MeshRays&&) noexcept = default;

std::uint32_t MeshRays::unoccluded(std::span<const Eigen::Vector3f> points,
                                   const Eigen::Vector3f& direction) const {
  alignas(64) RTCRay16 rays;
  const auto count = static_cast<unsigned>(std::min(points.size(), packet));
  fill_rays(reinterpret_cast<RTCRayN*>(&rays), count, points);
  std::fill_n(rays.dir_x, packet, direction.x());
  std::fill_n(rays.dir_y, packet, direction.y());
  std::fill_n(rays.dir_z, packet, direction.z());
  std::fill_n(rays.tfar, packet, std::numeric_limits<float>::infinity());
  return handles_->unoccluded(rays, count, true);
}

std::uint32_t MeshRays::unoccluded(std::span<const Eigen::Vector3f> points,
                                   std::span<const Eigen::Vector3f> directions,
                                   std::span<const float> distance) const {
  alignas(64) RTCRay16 rays;
  const auto count = static_cast<unsigned>(std::min(points.size(), packet));
  fill_rays(reinterpret_cast<RTCRayN*>(&rays), count, points);
  for (unsigned i = 0; i < count; ++i) {
    rays.dir_x[i] = directions[i].x();
    rays.dir_y[i] = directions[i].y();
    rays.dir_z[i] = directions[i].z();
    rays.tfar[i] = distance[i];
  }
  return handles_->unoccluded(rays, count, false);
}

std::optional<MeshHit> MeshRays::intersect(const Eigen::Vector3f& origin,
                                           const Eigen::Vector3f& direction) const {
  RTCRayHit query{};
  query.ray = {.org_x = origin.x(),
               .org_y = origin.y(),
               .org_z = origin.z(),
               .tnear = 0.0f,
               .dir_x = direction.x(),
               .dir_y = direction.y(),
               .dir_z = direction.z(),
               .time = 0.0f,
               .tfar = std::numeric_limits<float>::infinity(),
               .mask = ~0u,
               .id = 0,
               .flags = 0};
  query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect1(handles_->scene, &context, &query);
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
  const auto& triangle = mesh_->triangles[query.hit.primID];
  const Eigen::Vector3f a = mesh_->positions[triangle[1]] - mesh_->positions[triangle[0]];
  const Eigen::Vector3f b = mesh_->positions[triangle[2]] - mesh_->positions[triangle[0]];
  return MeshHit{query.hit.primID,
                 {1.0f - query.hit.u - query.hit.v, query.hit.u, query.hit.v},
                 query.ray.tfar,
                 a.cross(b).dot(direction) < 0.0f};
}

}  // namespace refield::prt
