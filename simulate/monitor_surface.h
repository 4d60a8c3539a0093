// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <vector>

#include "core/box.h"
#include "core/monitor_placement.h"
#include "simulate/scene_description.h"

namespace refield {

/// Where the monitor's texels lie in space. Columns run from left to right and rows downwards as someone in
/// front of the monitor sees them.
class MonitorSurface {
 public:
  explicit MonitorSurface(const MonitorInScene& monitor);

  const LightDomain& texels() const { return texels_; }
  const Eigen::Vector3f& normal() const { return normal_; }
  float texel_area() const { return texel_area_; }

  /// Position of a point given in texels, (0, 0) the top left corner, (width, height) the bottom right.
  Eigen::Vector3f point(float column, float row) const {
    return corner_ + column * column_step_ + row * row_step_;
  }

  /// Inverse of point(): the column and row of a position on the surface, in texels.
  Eigen::Vector2f texels_at(const Eigen::Vector3f& position) const;

  /// Texel that holds a position on the surface; positions on the rim count to the nearest texel.
  Eigen::Vector2i texel_at(const Eigen::Vector3f& position) const;

 private:
  LightDomain texels_;
  Eigen::Vector3f corner_, column_step_, row_step_, normal_;
  float texel_area_;
};

/// Where the monitor stands as seen from the scene, whose middle is what the camera looks at: the one
/// placement of a session of this scene. None when the middle lies behind the monitor.
std::vector<MonitorPlacement> monitor_placements(const SceneDescription& scene);

}  // namespace refield
