// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <cstdint>

#include "core/box.h"

namespace refield::prt {

/// A square of a cube map's face, in texels of the stacked faces (core/cube_map.h), and its name in the
/// quadtree of its face. Where a side is odd the first half is the larger one, so that sides of squares
/// differ by one at most and any resolution will do.
struct CubeSquare {
  Box box;
  std::uint32_t name = 0;  ///< 8 + face, then two bits for each quadrisection
};

inline constexpr int largest_cube_resolution = 4096;  ///< 12 quadrisections, 28 bits of a name

CubeSquare face_square(int face, int resolution);
/// Some are empty (area 0) where a side is one texel.
std::array<CubeSquare, 4> quadrisect(const CubeSquare& square);
/// The box of a name.
Box box_of_name(std::uint32_t name, int resolution);

}  // namespace refield::prt
