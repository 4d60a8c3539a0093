// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/mesh.h"

namespace refield::prt {

/// Meshes made by formula, white, centred at the origin, so that scenes need no files. `resolution` ≥ 1 says
/// how fine.

/// 1×1 in x and z, facing up; resolution² squares.
Mesh plane_mesh(int resolution);
/// 1×1×1 with hard edges; resolution² squares a face.
Mesh box_mesh(int resolution);
/// Of diameter 1: an icosahedron's edges divided by `resolution`, 10 · resolution² + 2 vertices.
Mesh sphere_mesh(int resolution);
/// A hare's head: a bumpy sphere, drawn out into two ears, a nose and cheeks, about 1 high. As many vertices
/// as sphere_mesh(). It stands for scanned figures: it shadows itself, and its normals go everywhere.
Mesh hare_mesh(int resolution);

}  // namespace refield::prt
