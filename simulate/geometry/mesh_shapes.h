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
/// Of diameter 1: an icosahedron's edges divided by `resolution`, 10 · resolution² + 2 vertices.
Mesh sphere_mesh(int resolution);
/// A rabbit's head: a bumpy sphere, drawn out into two ears, a nose and cheeks, about 1 high. As many
/// vertices as sphere_mesh(). It stands for scanned figures: it shadows itself, and its normals go
/// everywhere.
Mesh rabbit_mesh(int resolution);

/// More triangles than this no mesh is refined to; a field of them would not fit anywhere.
inline constexpr std::size_t max_triangles = std::size_t{1} << 26;

/// Halves edges longer than `longest_edge`, again and again, until none is: shadows and other changes of
/// light stand on vertices. An edge is halved for both its triangles, so no gaps arise. New vertices have the
/// mean position and colour and the mean normal's direction. Throws InputError where that takes more than
/// max_triangles, or for a length that is not above zero.
void refine(Mesh& mesh, float longest_edge);

}  // namespace refield::prt
