// SPDX-License-Identifier: Apache-2.0
#include "core/light/cube_map.h"

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

Image from_openexr_cube(const Image& stored) {
  const int resolution = stored.width, last = resolution - 1;
  if (stored.height != cube_faces * resolution)
    throw InputError("a cube map of OpenEXR has six square faces, one above the other, not ",
                     shape_text(stored));
  Image cube(stored.width, stored.height, stored.channels);
  for (int y = 0; y < cube.height; ++y)
    for (int x = 0; x < cube.width; ++x) {
      Eigen::Vector3d direction = cube_direction(x + 0.5, y + 0.5, resolution);
      direction.x() = -direction.x();  // OpenEXR's axes are right-handed
      int axis = 0;
      direction.cwiseAbs().maxCoeff(&axis);
      const auto place = [&](int along) {  // −1 to 1 becomes 0 to last
        return std::clamp(
            static_cast<int>((direction[along] / std::abs(direction[axis]) + 1.0) / 2.0 * resolution), 0,
            last);
      };
      const int face = 2 * axis + (direction[axis] < 0.0), first_row = face * resolution;
      const int p = place(axis == 0 ? 1 : 0), q = place(axis == 2 ? 1 : 2);
      int column = p, row = last - q;
      if (axis == 0) column = face == 0 ? q : last - q, row = last - p;
      if (face == 3) row = q;
      if (face == 4) column = last - p;
      std::copy_n(
          &stored.values[(static_cast<std::size_t>(first_row + row) * resolution + column) * stored.channels],
          stored.channels, &cube.at(x, y, 0));
    }
  return cube;
}

Eigen::Vector3d cube_direction(double column, double row, int resolution) {
  const int face = std::clamp(static_cast<int>(row / resolution), 0, cube_faces - 1);
  const double u = 2.0 * column / resolution - 1.0;
  const double v = 1.0 - 2.0 * (row - static_cast<double>(face) * resolution) / resolution;
  return (cube_face_axes(face).transpose() * Eigen::Vector3d(u, v, 1.0)).normalized();
}

Eigen::Vector2d cube_position(const Eigen::Vector3d& direction, int resolution) {
  Eigen::Index axis = 0;
  direction.cwiseAbs().maxCoeff(&axis);
  const int face = 2 * static_cast<int>(axis) + (direction[axis] < 0.0);
  const Eigen::Vector3d on_face = cube_face_axes(face) * direction / std::abs(direction[axis]);
  const double below = std::nextafter(resolution, 0.0);
  return {0.5 * (1.0 + on_face.x()) * resolution,
          face * resolution + std::min(0.5 * (1.0 - on_face.y()) * resolution, below)};
}

double cube_solid_angle(int x, int y, int resolution) {
  return cube_solid_angle(Box{x, y, x + 1, y + 1}, resolution);
}

double cube_solid_angle(const Box& box, int resolution) {
  const double step = 2.0 / resolution, u0 = box.x0 * step - 1.0, u1 = box.x1 * step - 1.0;
  double sum = 0.0;
  for (int face = box.y0 / resolution; face * resolution < box.y1; ++face) {
    const double v0 = std::max(box.y0 - face * resolution, 0) * step - 1.0,
                 v1 = std::min(box.y1 - face * resolution, resolution) * step - 1.0;
    sum += angle_up_to(u1, v1) - angle_up_to(u0, v1) - angle_up_to(u1, v0) + angle_up_to(u0, v0);
  }
  return sum;
}

Eigen::Vector3d cube_mean_direction(int x, int y, int resolution) {
  const double step = 2.0 / resolution;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double total = 0.0;
  for (const auto& [column, row] : square_gauss_points) {
    const Eigen::Vector3d on_face((x + column) * step - 1.0, 1.0 - (y % resolution + row) * step, 1.0);
    const double squared = on_face.squaredNorm(), density = 1.0 / (squared * std::sqrt(squared));
    sum += density / std::sqrt(squared) * on_face;
    total += density;
  }
  return sum / total;
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
