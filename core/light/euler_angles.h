// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>

namespace refield {

/// A turn in the axes of light maps (lat_long_direction(): +X right, +Y up, +Z ahead), in degrees, the same
/// for cameras, monitors and maps: first roll, then pitch, then yaw, each about an axis that stands still.
/// Someone who looks ahead and is turned so looks right by yaw, then down by pitch, with his head rolled.
struct EulerAngles {
  double yaw = 0.0;    ///< to the right, +Z towards +X
  double pitch = 0.0;  ///< down, +Z towards −Y
  double roll = 0.0;   ///< what was right goes up, +X towards +Y

  bool operator==(const EulerAngles&) const = default;

  /// Takes what was to where it goes: matrix() · (0, 0, 1) is where someone so turned looks.
  Eigen::Matrix3d matrix() const;

  /// Whether nothing moves, full circles included.
  bool is_none() const;
};

}  // namespace refield
