// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "simulate/tabletop/scene.h"

namespace refield {

/// Triangles in the object's own frame. The front side of a triangle sees its corners counter-clockwise.
struct TriangleMesh {
  std::vector<Eigen::Vector3f> vertices;
  std::vector<Eigen::Vector3f> normals;  ///< one a vertex, unit
  std::vector<std::array<std::uint32_t, 3>> triangles;
};

/// Horizontal rectangle of size.x × size.z about the origin, front side up.
TriangleMesh quad_mesh(const Eigen::Vector3d& size);

/// Axis-aligned box about the origin.
TriangleMesh box_mesh(const Eigen::Vector3d& size);

/// Surface of revolution about +Y. The outside lies to the right of the profile's direction, so a closed
/// solid starts on the axis at the bottom. With `smooth` a Catmull–Rom curve runs through the profile; a
/// point given twice stays a sharp corner.
TriangleMesh lathe_mesh(const std::vector<Eigen::Vector2d>& profile, bool smooth);

}  // namespace refield
