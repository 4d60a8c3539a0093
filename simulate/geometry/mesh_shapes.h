// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/field/mesh.h"

namespace refield::prt {

/// Meshes made by formula, white, centred at the origin, so that scenes need no files. `resolution` ≥ 1 says
/// how fine.

/// 1×1 in x and z, facing up; resolution² squares.
Mesh plane_mesh(int resolution);
/// 1×1×1 with hard edges; resolution² squares per face.
Mesh box_mesh(int resolution);
/// A sphere of diameter 1: an icosahedron's edges divided by `resolution`, 10 · resolution² + 2 vertices.
Mesh sphere_mesh(int resolution);
/// A rabbit's head: a bumpy sphere, drawn out into two ears, a nose and cheeks, about 1 high. As many
/// vertices as sphere_mesh(). It stands for scanned figures: it shadows itself, and its normals go
/// everywhere.
Mesh rabbit_mesh(int resolution);

/// Surface of revolution about +Y. The outside lies to the right of the direction of the profile (radius,
/// height), so a closed solid starts on the axis at the bottom. With `smooth` a Catmull–Rom curve runs
/// through the profile; a point given twice stays a sharp corner.
Mesh lathe_mesh(const std::vector<Eigen::Vector2d>& profile, bool smooth);

}  // namespace refield::prt
