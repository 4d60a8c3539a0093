// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/scene/drag.h"

#include <Eigen/Geometry>
#include <cmath>

namespace refield {

namespace {

/// Below this sine between line of sight and plane (6°) a pixel stands for too long a piece of it.
constexpr float least_slope = 0.1f;
constexpr float farthest = 10.0f;

/// Normal of the plane: where it would be seen too flat, the picture's.
Eigen::Vector3f normal_of(const PinholeCamera& camera, const Eigen::Vector3f& point, DragPlane plane) {
  const Eigen::Vector3f ahead = camera.axes().row(2).transpose();
  const Eigen::Vector3f sight = (point - camera.position).normalized();
  if (plane == DragPlane::level) return std::abs(sight.y()) < least_slope ? ahead : Eigen::Vector3f::UnitY();
  const Eigen::Vector3f level(sight.x(), 0.0f, sight.z());
  return level.norm() < least_slope ? ahead : level.normalized();
}

}  // namespace

Eigen::Vector3f dragged_shift(const PinholeCamera& camera, const Eigen::Vector3f& point,
                              const Eigen::Vector2f& from_px, const Eigen::Vector2f& to_px, DragPlane plane) {
  const float distance = (point - camera.position).norm();
  if (!(distance > 0.0f)) return Eigen::Vector3f::Zero();
  const Eigen::Vector3f normal = normal_of(camera, point, plane);
  const float height = normal.dot(point - camera.position);
  const auto meets = [&](const Eigen::Vector2f& px) -> Eigen::Vector3f {
    const Eigen::Vector3f direction = camera.direction(px.x(), px.y());
    const float slope = normal.dot(direction);
    float along = height / slope;
    // Beyond the horizon of the plane, or behind the camera: as far as it goes.
    if (!(along > 0.0f) || along > farthest * distance) along = farthest * distance;
    return camera.position + along * direction;
  };
  Eigen::Vector3f shift = meets(to_px) - meets(from_px);
  shift -= shift.dot(normal) * normal;
  if (plane == DragPlane::upright && std::abs(normal.y()) < 0.5f)
    shift = Eigen::Vector3f(0.0f, shift.y(), 0.0f);
  const float length = shift.norm();
  return length > farthest * distance ? Eigen::Vector3f(shift * (farthest * distance / length)) : shift;
}

}  // namespace refield
