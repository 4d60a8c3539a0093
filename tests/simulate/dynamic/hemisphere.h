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

/// A measured table of a BRDF given by formula.
inline BrdfTable table_of(const Brdf& brdf, int theta_in, int theta_out, int delta_phi) {
  const auto direction = [](double height_share, double turn) {
    // At the horizon itself all is zero.
    const double theta = std::min(height_share, 0.9999) * std::numbers::pi / 2;
    return Eigen::Vector3d(std::sin(theta) * std::cos(turn), std::sin(theta) * std::sin(turn),
                           std::cos(theta))
        .cast<float>()
        .eval();
  };
  std::vector<Eigen::Array3f> values;
  for (int i = 0; i < theta_in; ++i)
    for (int j = 0; j < theta_out; ++j)
      for (int k = 0; k < delta_phi; ++k)
        values.push_back(brdf(
            direction(static_cast<double>(i) / (theta_in - 1), 0.0),
            direction(static_cast<double>(j) / (theta_out - 1), std::numbers::pi * k / (delta_phi - 1))));
  return {theta_in, theta_out, delta_phi, values};
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
