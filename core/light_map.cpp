// SPDX-License-Identifier: Apache-2.0
#include "core/light_map.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/errors.h"

namespace refield {

std::string_view name_of(Parameterisation parameterisation) {
  switch (parameterisation) {
    case Parameterisation::monitor:
      return "monitor";
    case Parameterisation::lat_long:
      return "lat_long";
    case Parameterisation::cube:
      return "cube";
  }
  throw InputError("unknown light map parameterisation");
}

Parameterisation parameterisation_from_name(std::string_view name) {
  for (auto p : {Parameterisation::monitor, Parameterisation::lat_long, Parameterisation::cube})
    if (name == name_of(p)) return p;
  throw InputError("unknown light map parameterisation '" + std::string(name) +
                   "'; use monitor, lat_long or cube");
}

Eigen::Vector3d lat_long_direction(double column, double row, int width, int height) {
  const double phi = 2.0 * std::numbers::pi * column / width;
  const double theta = std::numbers::pi * row / height;
  return {-std::sin(theta) * std::sin(phi), std::cos(theta), -std::sin(theta) * std::cos(phi)};
}

Eigen::Vector2d lat_long_position(const Eigen::Vector3d& direction, int width, int height) {
  double turn = std::atan2(-direction.x(), -direction.z()) / (2.0 * std::numbers::pi);
  if (turn < 0.0) turn += 1.0;
  if (turn >= 1.0) turn = 0.0;
  const double theta = std::acos(std::clamp(direction.y(), -1.0, 1.0));
  return {turn * width, theta / std::numbers::pi * height};
}

}  // namespace refield
