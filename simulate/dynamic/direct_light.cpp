// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/direct_light.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "simulate/dynamic/brdf.h"

namespace refield::dynamic {

namespace {

constexpr std::size_t packet = prt::ray_packet;
/// Rays start off their surface and end before the area light by so much of their length.
constexpr float ray_start = 1e-3f, ray_end = 1.0f - 1e-3f;

/// Up to 16 vertices of which rays go to one area light at a time.
class Batch {
 public:
  Batch(const MovingObject& object, const Pose& pose, const Eigen::Vector3f& eye, std::size_t first)
      : brdf_(object.brdf), first_(first), count_(std::min(packet, object.mesh.positions.size() - first)) {
    for (std::size_t i = 0; i < count_; ++i) {
      at_[i] = pose * object.mesh.positions[first + i];
      frame_[i] = tangent_frame(object.mesh.normals[first + i]) * pose.linear().transpose();
      to_eye_[i] = frame_[i] * (eye - at_[i]).normalized();
    }
  }

  void add(const AreaPoint& area_light, const BrdfFactors& factors, const SceneRays& rays, std::span<float> h,
           DirectLight& light) const {
    std::array<Eigen::Vector3f, packet> from, way, local;
    std::array<float, packet> end;
    std::array<std::size_t, packet> of;
    std::size_t count = 0;
    for (std::size_t i = 0; i < count_; ++i) {
      way[count] = area_light.position - at_[i];
      local[count] = frame_[i] * way[count];
      if (local[count].z() <= 0.0f) continue;
      from[count] = at_[i] + ray_start * way[count];
      end[count] = ray_end - ray_start;
      of[count++] = i;
    }
    if (count == 0) return;
    const std::uint32_t free = rays.unoccluded(std::span(from).first(count), way, end);
    for (std::size_t i = 0; i < count; ++i) {
      if (!((free >> i) & 1u)) continue;
      const float squared = way[i].squaredNorm(), distance = std::sqrt(squared);
      const Eigen::Vector3f towards = local[i] / distance;
      factors.incoming(towards, h);
      const float cosine = std::abs(area_light.normal.dot(way[i])) / distance * towards.z();
      const Eigen::Array3f arriving = area_light.power * (cosine / std::max(squared, area_light.area));
      for (std::size_t k = 0; k < h.size(); ++k)
        light.terms.row(static_cast<Eigen::Index>((first_ + of[i]) * h.size() + k)) +=
            h[k] * arriving.matrix().transpose();
      light.to_eye[first_ + of[i]] += brdf_(towards, to_eye_[of[i]]) * arriving;
    }
  }

 private:
  const Brdf& brdf_;
  std::size_t first_, count_;
  std::array<Eigen::Vector3f, packet> at_, to_eye_;
  std::array<Eigen::Matrix3f, packet> frame_;
};

}  // namespace

DirectLight direct_light(const MovingObject& object, const Pose& pose, const BrdfFactors& factors,
                         const SceneRays& rays, std::span<const AreaPoint> area_lights,
                         const Eigen::Vector3f& eye) {
  const auto terms = static_cast<std::size_t>(factors.terms());
  const std::size_t vertices = object.mesh.positions.size();
  DirectLight light{TermLight::Zero(static_cast<Eigen::Index>(vertices * terms), 3),
                    std::vector<Eigen::Array3f>(vertices, Eigen::Array3f::Zero())};
  tbb::parallel_for(std::size_t{0}, (vertices + packet - 1) / packet, [&](std::size_t b) {
    std::vector<float> h(terms);
    const Batch batch(object, pose, eye, b * packet);
    for (const AreaPoint& area_light : area_lights) batch.add(area_light, factors, rays, h, light);
  });
  return light;
}

}  // namespace refield::dynamic
