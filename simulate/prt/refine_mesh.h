// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/mesh.h"

namespace refield::prt {

/// More triangles than this no mesh is refined to; a field of them would not fit anywhere.
inline constexpr std::size_t most_triangles = std::size_t{1} << 26;

/// Halves edges longer than `longest_edge`, again and again, until none is: shadows and other changes of
/// light stand on vertices. An edge is halved for both its triangles, so no gaps arise. New vertices have the
/// mean position and colour and the mean normal's direction. Throws InputError where that takes more than
/// most_triangles, or for a length that is not above zero.
void refine(Mesh& mesh, float longest_edge);

}  // namespace refield::prt
