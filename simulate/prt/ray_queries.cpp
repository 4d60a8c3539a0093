// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/ray_queries.h"

#include <embree3/rtcore.h>

#include <algorithm>
#include <limits>

namespace refield::prt {

std::uint32_t unoccluded(RTCSceneTy* scene, std::span<const Eigen::Vector3f> points,
                         std::span<const Eigen::Vector3f> directions, std::span<const float> distance,
                         bool coherent) {
  if (points.empty()) return 0;
  alignas(64) RTCRay16 rays;
  alignas(64) int valid[ray_packet];
  const std::size_t count = std::min(points.size(), ray_packet);
  for (std::size_t i = 0; i < ray_packet; ++i) {
    // Idle lanes hold the first ray: what is in them is looked at where packets go through instances.
    const std::size_t of = i < count ? i : 0;
    valid[i] = i < count ? -1 : 0;
    rays.org_x[i] = points[of].x();
    rays.org_y[i] = points[of].y();
    rays.org_z[i] = points[of].z();
    rays.dir_x[i] = directions[of].x();
    rays.dir_y[i] = directions[of].y();
    rays.dir_z[i] = directions[of].z();
    rays.tfar[i] = distance[of];
    rays.tnear[i] = rays.time[i] = 0.0f;
    rays.id[i] = static_cast<unsigned>(i);
    rays.mask[i] = ~0u;
    rays.flags[i] = 0;
  }
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  if (coherent) context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  rtcOccluded16(valid, scene, &context, &rays);
  std::uint32_t free = 0;
  for (std::size_t i = 0; i < count; ++i) free |= static_cast<std::uint32_t>(rays.tfar[i] >= 0.0f) << i;
  return free;
}

std::optional<FirstHit> first_hit(RTCSceneTy* scene, const Eigen::Vector3f& origin,
                                  const Eigen::Vector3f& direction) {
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
  rtcIntersect1(scene, &context, &query);
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
  return FirstHit{query.hit.instID[0], query.hit.primID, query.hit.u, query.hit.v, query.ray.tfar};
}

}  // namespace refield::prt
