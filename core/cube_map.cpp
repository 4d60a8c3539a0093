// SPDX-License-Identifier: Apache-2.0
#include "core/cube_map.h"

#include <algorithm>
#include <cmath>

namespace refield {

Eigen::Vector3d cube_direction(double column, double row, int resolution) {
  const int face = std::clamp(static_cast<int>(row / resolution), 0, cube_faces - 1);
  const double u = 2.0 * column / resolution - 1.0;
  const double v = 1.0 - 2.0 * (row - static_cast<double>(face) * resolution) / resolution;
  return (cube_face_axes(face).transpose() * Eigen::Vector3d(u, v, 1.0)).normalized();
}

double cube_solid_angle(int x, int y, int resolution) {
  // Of the rectangle between the face's middle and (u, v), with the cube's faces at distance 1.
  const auto up_to = [](double u, double v) { return std::atan2(u * v, std::sqrt(u * u + v * v + 1.0)); };
  const double step = 2.0 / resolution;
  const double u0 = x * step - 1.0, v0 = y % resolution * step - 1.0;
  const double u1 = u0 + step, v1 = v0 + step;
  return up_to(u1, v1) - up_to(u0, v1) - up_to(u1, v0) + up_to(u0, v0);
}

}  // namespace refield
