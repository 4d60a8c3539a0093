// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/hammersley.h"

#include <cmath>
#include <numbers>

namespace refield::prt {

double radical_inverse(std::uint32_t k) {
  double value = 0.0;
  for (double digit = 0.5; k > 0; k >>= 1, digit *= 0.5)
    if (k & 1) value += digit;
  return value;
}

std::vector<Eigen::Vector3d> hammersley_sphere(int count) {
  std::vector<Eigen::Vector3d> directions;
  directions.reserve(static_cast<std::size_t>(count));
  for (int k = 0; k < count; ++k) {
    const double z = 1.0 - (2.0 * k + 1.0) / count, radius = std::sqrt(1.0 - z * z);
    const double phi = 2.0 * std::numbers::pi * radical_inverse(static_cast<std::uint32_t>(k));
    directions.emplace_back(radius * std::cos(phi), radius * std::sin(phi), z);
  }
  return directions;
}

}  // namespace refield::prt
