// SPDX-License-Identifier: Apache-2.0
#include "simulate/tabletop/light_transport.h"

#include <gtest/gtest.h>

#include <set>

namespace refield {
namespace {

TEST(LightHierarchy, EveryLevelCoversTheMapOnce) {
  const LightHierarchy hierarchy({100, 37, Parameterisation::monitor});  // nothing divides evenly
  for (int level = 0; level <= hierarchy.coarsest_level(); ++level) {
    std::vector<int> covered(100 * 37, 0);
    for (int row = 0; row < hierarchy.rows(level); ++row)
      for (int column = 0; column < hierarchy.columns(level); ++column) {
        const Box box = hierarchy.box(level, column, row);
        ASSERT_TRUE(box.inside(100, 37));
        for (int y = box.y0; y < box.y1; ++y)
          for (int x = box.x0; x < box.x1; ++x) ++covered[y * 100 + x];
      }
    for (int count : covered) ASSERT_EQ(count, 1) << "level " << level;
  }
}

TEST(LightHierarchy, CoarsestBoxesAreNoLargerThanASixteenthOfTheWidth) {
  for (int width : {8, 16, 31, 128, 192, 800}) {
    const LightHierarchy hierarchy({width, width, Parameterisation::monitor});
    const int side = 1 << hierarchy.coarsest_level();
    EXPECT_LE(side, std::max(1, width / 16)) << width;
    EXPECT_GT(2 * side * 16, width) << width;
  }
}

TEST(LightHierarchy, NumbersAndBoxesAgree) {
  const LightHierarchy hierarchy({70, 50, Parameterisation::monitor});
  std::set<std::uint32_t> seen;
  for (int level = 0; level <= hierarchy.coarsest_level(); ++level)
    for (int row = 0; row < hierarchy.rows(level); ++row)
      for (int column = 0; column < hierarchy.columns(level); ++column) {
        const std::uint32_t node = hierarchy.node(level, column, row);
        EXPECT_TRUE(seen.insert(node).second);
        EXPECT_EQ(hierarchy.box(node), hierarchy.box(level, column, row));
        const Box box = hierarchy.box(node);
        EXPECT_EQ(hierarchy.node_of_texel(level, box.x0, box.y0), node);
      }
  EXPECT_EQ(seen.size(), hierarchy.size());
}

}  // namespace
}  // namespace refield
