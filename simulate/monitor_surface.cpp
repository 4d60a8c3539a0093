// SPDX-License-Identifier: Apache-2.0
#include "simulate/monitor_surface.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace refield {

MonitorSurface::MonitorSurface(const MonitorInScene& monitor) : texels_(monitor.texels) {
  const Eigen::Vector3d normal = monitor.facing.normalized();
  const Eigen::Vector3d right =
      Eigen::Vector3d::UnitY().cross(normal).normalized();  // for someone in front of it
  const Eigen::Vector3d up = normal.cross(right);
  normal_ = normal.cast<float>();
  corner_ = (monitor.centre - 0.5 * monitor.width_m * right + 0.5 * monitor.height_m * up).cast<float>();
  column_step_ = (monitor.width_m / texels_.width * right).cast<float>();
  row_step_ = (-monitor.height_m / texels_.height * up).cast<float>();
  texel_area_ = column_step_.norm() * row_step_.norm();
}

Eigen::Vector2f MonitorSurface::texels_at(const Eigen::Vector3f& position) const {
  const Eigen::Vector3f d = position - corner_;
  return {d.dot(column_step_) / column_step_.squaredNorm(), d.dot(row_step_) / row_step_.squaredNorm()};
}

Eigen::Vector2i MonitorSurface::texel_at(const Eigen::Vector3f& position) const {
  const Eigen::Vector2f at = texels_at(position);
  return {std::clamp(static_cast<int>(std::floor(at.x())), 0, texels_.width - 1),
          std::clamp(static_cast<int>(std::floor(at.y())), 0, texels_.height - 1)};
}

}  // namespace refield
