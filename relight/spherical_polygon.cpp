// SPDX-License-Identifier: Apache-2.0
#include "relight/spherical_polygon.h"

#include <Eigen/Geometry>
#include <cmath>

namespace refield {

void split(const SphericalPolygon& polygon, const Eigen::Vector3d& normal, SphericalPolygon& inside,
           SphericalPolygon& outside) {
  inside.clear();
  outside.clear();
  if (polygon.empty()) return;
  const Eigen::Vector3d* before = &polygon.back();
  double height_before = normal.dot(*before);
  for (const Eigen::Vector3d& corner : polygon) {
    const double height = normal.dot(corner);
    if ((height >= 0.0) != (height_before >= 0.0)) {
      const double share = height_before / (height_before - height);
      const Eigen::Vector3d cut = *before + share * (corner - *before);
      inside.push_back(cut);
      outside.push_back(cut);
    }
    (height >= 0.0 ? inside : outside).push_back(corner);
    before = &corner;
    height_before = height;
  }
}

double solid_angle(const SphericalPolygon& polygon) {
  if (polygon.size() < 3) return 0.0;
  const Eigen::Vector3d a = polygon[0].normalized();
  Eigen::Vector3d b = polygon[1].normalized();
  double sum = 0.0;
  for (std::size_t i = 2; i < polygon.size(); ++i) {
    const Eigen::Vector3d c = polygon[i].normalized();
    // Edges instead of corners: the determinant of three nearly equal vectors would cancel.
    const double volume = a.dot((b - a).cross(c - a));
    sum += 2.0 * std::atan2(volume, 1.0 + a.dot(b) + b.dot(c) + c.dot(a));
    b = c;
  }
  return std::abs(sum);
}

}  // namespace refield
