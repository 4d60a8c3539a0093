// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cmath>
#include <numbers>
#include <vector>

#include "simulate/dynamic/brdf.h"

namespace refield::dynamic::test {

/// `count` unit directions, evenly over the upper hemisphere, 2π ∕ count steradians each (golden angle).
inline std::vector<Eigen::Vector3f> hemisphere(int count) {
  std::vector<Eigen::Vector3f> directions;
  for (int i = 0; i < count; ++i) {
    const double z = 1.0 - (i + 0.5) / count, across = std::sqrt(1.0 - z * z);
    const double turn = 2.0 * std::numbers::pi * (2.0 - std::numbers::phi) * i;
    directions.push_back(Eigen::Vector3d(across * std::cos(turn), across * std::sin(turn), z).cast<float>());
  }
  return directions;
}

/// Of all kinds, gently varying.
inline std::vector<Brdf> assorted_brdfs() {
  return {
      {.diffuse = {0.5f, 0.5f, 0.5f}},
      {.diffuse = {0.2f, 0.2f, 0.2f}, .specular = {0.5f, 0.5f, 0.5f}, .lobe = Lobe::phong, .exponent = 10},
      {.diffuse = {0.1f, 0.1f, 0.1f},
       .specular = {0.04f, 0.04f, 0.04f},
       .lobe = Lobe::ggx,
       .roughness = 0.4f}};
}

}  // namespace refield::dynamic::test
