// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Geometry>
#include <optional>

#include "core/field/mesh.h"
#include "core/light/euler_angles.h"

namespace refield::prt {

/// Where a mesh stands in a scene, in the order in which it is done.
struct Placement {
  Eigen::Vector3f stretch = {1.0f, 1.0f, 1.0f};  ///< along the mesh's own axes, all above zero
  EulerAngles turn = {};
  std::optional<float> size = std::nullopt;                ///< the longest side of its bounding box
  std::optional<Eigen::Vector3f> position = std::nullopt;  ///< where the middle of its bounding box comes
  /// Its lowest point comes to height 0; above the origin where no position is given.
  bool on_ground = false;
};

/// Moves a mesh; normals follow. Throws InputError where coordinates leave what float can hold.
void place(Mesh& mesh, const Placement& placement);

/// Joins a mesh, moved, to others.
void append(const Mesh& mesh, const Eigen::Isometry3f& pose, Mesh& all);

}  // namespace refield::prt
