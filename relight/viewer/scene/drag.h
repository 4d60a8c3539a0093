// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>

#include "core/camera.h"

namespace refield {

/// The plane that a thing is dragged in: along the floor, or straight up and down.
enum class DragPlane { level, upright };

/// By how much a point moves so that it follows the pointer from one pixel to another. Level with a camera
/// that looks along the floor or from below it, and upright with one that looks straight down, pixels tell
/// no place there: it then moves in the plane of the picture. Never further than ten times its distance from
/// the camera.
Eigen::Vector3f dragged_shift(const PinholeCamera& camera, const Eigen::Vector3f& point,
                              const Eigen::Vector2f& from_px, const Eigen::Vector2f& to_px, DragPlane plane);

}  // namespace refield
