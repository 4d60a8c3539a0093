// SPDX-License-Identifier: Apache-2.0
#include "core/cube_map.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace refield {

namespace {

/// Solid angle of the rectangle between a face's middle and (u, v), the face at distance 1.
double angle_up_to(double u, double v) {
  return std::atan2(u * v, std::sqrt(u * u + v * v + 1.0));
}

}  // namespace

Eigen::Vector3d cube_direction(double column, double row, int resolution) {
  const int face = std::clamp(static_cast<int>(row / resolution), 0, cube_faces - 1);
  const double u = 2.0 * column / resolution - 1.0;
  const double v = 1.0 - 2.0 * (row - static_cast<double>(face) * resolution) / resolution;
  return (cube_face_axes(face).transpose() * Eigen::Vector3d(u, v, 1.0)).normalized();
}

double cube_solid_angle(int x, int y, int resolution) {
  const double step = 2.0 / resolution;
  const double u0 = x * step - 1.0, v0 = y % resolution * step - 1.0;
  const double u1 = u0 + step, v1 = v0 + step;
  return angle_up_to(u1, v1) - angle_up_to(u0, v1) - angle_up_to(u1, v0) + angle_up_to(u0, v0);
}

std::vector<float> cube_solid_angles(int resolution) {
  const auto side = static_cast<std::size_t>(resolution);
  std::vector<float> angles(side * side);
  tbb::parallel_for(0, resolution, [&](int y) {
    const double step = 2.0 / resolution, v0 = y * step - 1.0, v1 = v0 + step;
    double left = angle_up_to(-1.0, v1) - angle_up_to(-1.0, v0);
    for (int x = 0; x < resolution; ++x) {
      const double u = (x + 1) * step - 1.0, right = angle_up_to(u, v1) - angle_up_to(u, v0);
      angles[static_cast<std::size_t>(y) * side + static_cast<std::size_t>(x)] =
          static_cast<float>(right - left);
      left = right;
    }
  });
  return angles;
}

}  // namespace refield
