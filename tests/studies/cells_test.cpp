// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/peers/cells.h"

#include <gtest/gtest.h>

#include "core/base/errors.h"
#include "tests/studies/peer_fixture.h"
#include "tests/support/synthetic_capture.h"

namespace refield {
namespace {

constexpr double float_rounding = 1e-5;

TEST(LightCells, CoverTheMapOnceInAtMostSoManyCells) {
  for (const auto& [width, height] : {std::pair{128, 96}, {13, 7}, {1, 1}, {5, 40}})
    for (const int count : {1, 2, 7, 25, 59, 180}) {
      const auto cells = peers::light_cells({width, height, Parameterisation::monitor}, count);
      EXPECT_LE(cells.size(), static_cast<std::size_t>(count));
      std::vector<int> covered(static_cast<std::size_t>(width) * height, 0);
      for (const Box& cell : cells) {
        ASSERT_TRUE(cell.inside(width, height));
        for (int y = cell.y0; y < cell.y1; ++y)
          for (int x = cell.x0; x < cell.x1; ++x) ++covered[static_cast<std::size_t>(y) * width + x];
      }
      EXPECT_EQ(std::count(covered.begin(), covered.end(), 1), width * height) << count;
    }
}

TEST(LightCells, UseTheImagesThereAre) {
  const LightDomain domain{128, 96, Parameterisation::monitor};
  for (const int count : {25, 50, 100, 180}) EXPECT_EQ(peers::light_cells(domain, count).size(), count);
  EXPECT_GE(peers::light_cells(domain, 59).size(), 54u);  // a prime number fits no grid
}

TEST(CellModel, IsExactWhereTransportIsConstantOverCells) {
  const LightDomain domain{20, 12, Parameterisation::monitor};
  const auto cells = peers::light_cells(domain, 12);
  const ReflectanceField truth = test::field_of_boxes(6, 4, domain, cells, 5);
  std::vector<Image> photographs;
  for (const Box& cell : cells) photographs.push_back(truth.relight(peers::cell_light(domain, cell)));
  const auto model = peers::fit_cells(domain, cells, photographs);
  for (const LightMap& light : test::random_lights(4, domain.width, domain.height, 9))
    EXPECT_LT(test::relative_difference(model.relight(light), truth.relight(light)), float_rounding);
}

TEST(CellModel, RefusesPhotographsThatDoNotFit) {
  const LightDomain domain{20, 12, Parameterisation::monitor};
  const std::vector<Image> two = {Image(4, 3, 3), Image(4, 4, 3)};
  EXPECT_THROW(peers::fit_cells(domain, peers::light_cells(domain, 3), two), InputError);
  EXPECT_THROW(peers::fit_cells(domain, peers::light_cells(domain, 2), two), InputError);
}

}  // namespace
}  // namespace refield
