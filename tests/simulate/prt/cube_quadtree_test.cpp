// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/clusters.h"

#include <gtest/gtest.h>

#include <set>

#include "core/light/cube_map.h"

namespace refield::prt {
namespace {

/// Visits all squares below one; counts how many times each texel is reached.
void visit(const CubeSquare& square, int resolution, std::vector<int>& reached,
           std::set<std::uint32_t>& names) {
  EXPECT_TRUE(names.insert(square.name).second) << "a name is given twice";
  EXPECT_EQ(box_of_name(square.name, resolution), square.box);
  EXPECT_LE(std::abs(square.box.width() - square.box.height()), 1);
  if (square.box.area() == 1) {
    ++reached[static_cast<std::size_t>(square.box.y0) * resolution + square.box.x0];
    return;
  }
  for (const CubeSquare& part : quadrisect(square))
    if (part.box.area() > 0) visit(part, resolution, reached, names);
}

TEST(CubeQuadtree, SquaresOfAnyResolutionEndInEachTexelOnceAndAreFoundByTheirNames) {
  for (const int resolution : {1, 2, 3, 7, 13, 32}) {
    std::vector<int> reached(static_cast<std::size_t>(cube_faces) * resolution * resolution);
    std::set<std::uint32_t> names;
    for (int face = 0; face < cube_faces; ++face)
      visit(face_square(face, resolution), resolution, reached, names);
    EXPECT_EQ(std::vector<int>(reached.size(), 1), reached) << resolution;
  }
}

TEST(CubeQuadtree, NamesHoldTheLastTexelOfTheLargestCube) {
  CubeSquare square = face_square(cube_faces - 1, largest_cube_resolution);
  while (square.box.area() > 1) square = quadrisect(square)[3];
  EXPECT_EQ(box_of_name(square.name, largest_cube_resolution), square.box);
  EXPECT_EQ(square.box.x1, largest_cube_resolution);
}

}  // namespace
}  // namespace refield::prt
