// SPDX-License-Identifier: Apache-2.0
#include "simulate/monitor_surface.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "core/units.h"

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

std::vector<MonitorPlacement> monitor_placements(const SceneDescription& scene) {
  constexpr double mm_per_m = 1000.0;
  const Eigen::Vector3d up = Eigen::Vector3d::UnitY();
  const Eigen::Vector3d looks = scene.camera.target - scene.camera.position;
  const Eigen::Vector3d ahead = (looks - looks.dot(up) * up).normalized();
  Eigen::Matrix3d scene_from_world;  // into the left-handed axes of light maps
  scene_from_world << ahead.cross(up).transpose(), up.transpose(), ahead.transpose();
  const Eigen::Vector3d onto_screen = -(scene_from_world * scene.monitor.facing.normalized());
  MonitorPlacement placement;
  placement.turn.yaw = degrees_from_radians(std::atan2(onto_screen.x(), onto_screen.z()));
  placement.turn.pitch = -degrees_from_radians(std::asin(std::clamp(onto_screen.y(), -1.0, 1.0)));
  const Eigen::Vector3d centre =
      placement.turn.matrix().transpose() * scene_from_world * (scene.monitor.centre - scene.camera.target);
  placement.width_mm = mm_per_m * scene.monitor.width_m;
  placement.height_mm = mm_per_m * scene.monitor.height_m;
  placement.distance_mm = mm_per_m * centre.z();
  placement.offset_x_mm = mm_per_m * centre.x();
  placement.offset_y_mm = mm_per_m * centre.y();
  if (!(placement.distance_mm > 0.0)) return {};
  return {placement};
}

}  // namespace refield
