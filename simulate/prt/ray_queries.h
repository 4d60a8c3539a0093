// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <span>

struct RTCSceneTy;  // Embree's, whose headers stay in .cpp files

namespace refield::prt {

inline constexpr std::size_t ray_packet = 16;

/// Which of up to 16 rays meet nothing, a bit each. `distance`: infinity, or where a ray ends, in lengths of
/// its direction. Coherent ones, which start near each other and go nearly alike, are faster if told to be.
std::uint32_t unoccluded(RTCSceneTy* scene, std::span<const Eigen::Vector3f> points,
                         std::span<const Eigen::Vector3f> directions, std::span<const float> distance,
                         bool coherent);

/// What a ray meets first.
struct FirstHit {
  std::uint32_t instance;  ///< of a scene of scenes
  std::uint32_t triangle;
  float u, v;  ///< shares of the triangle's second and third vertex
  float distance;
};
std::optional<FirstHit> first_hit(RTCSceneTy* scene, const Eigen::Vector3f& origin,
                                  const Eigen::Vector3f& direction);

}  // namespace refield::prt
