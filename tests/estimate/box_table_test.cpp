// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/box_table.h"

#include <gtest/gtest.h>

#include "core/base/errors.h"
#include "core/base/rng.h"
#include "core/light/summed_area_table.h"
#include "estimate/fit/kernel_cache.h"
#include "tests/support/synthetic_capture.h"

namespace refield {
namespace {

TEST(BoxTable, ColumnsAreTheSumsOfEachLight) {
  const auto lights = test::random_lights(21, 37, 23, 1);  // neither a group of lights nor a vector is full
  const BoxTable table(lights);
  std::vector<float> column(3 * table.stride());
  Rng rng(2);
  for (int trial = 0; trial < 200; ++trial) {
    const int x0 = static_cast<int>(rng.below(37)), y0 = static_cast<int>(rng.below(23));
    const Box box{x0, y0, x0 + 1 + static_cast<int>(rng.below(37 - x0)),
                  y0 + 1 + static_cast<int>(rng.below(23 - y0))};
    table.column(box, column.data());
    for (int j = 0; j < 21; ++j) {
      const auto expected = SummedAreaTable(lights[j].radiance).sum(box);
      for (int c = 0; c < 3; ++c)
        EXPECT_NEAR(column[c * table.stride() + j], expected[c], 1e-6 * expected[c] + 1e-12);
    }
    for (std::size_t j = 21; j < table.stride(); ++j) EXPECT_EQ(column[j], 0.0f);
  }
}

TEST(BoxTable, ASunDoesNotCostItsNeighboursTheirDigits) {
  auto lights = test::random_lights(2, 200, 100, 3);
  for (auto& light : lights)
    for (int c = 0; c < 3; ++c) light.radiance.at(10, 10, c) = 1e5f;
  const BoxTable table(lights);
  std::vector<float> column(3 * table.stride());
  table.column({150, 80, 151, 81}, column.data());
  for (int j = 0; j < 2; ++j)
    EXPECT_NEAR(column[j], lights[j].radiance.at(150, 80, 0), 1e-6 * lights[j].radiance.at(150, 80, 0));
}

TEST(BoxTable, BlackAndUnevenLightsAreRefused) {
  auto lights = test::random_lights(3, 8, 8, 1);
  lights[1].radiance = Image(8, 8, 3);
  EXPECT_THROW(BoxTable{lights}, InputError);
  lights[1].radiance = Image(9, 8, 3, 1.0f);
  EXPECT_THROW(BoxTable{lights}, InputError);
  EXPECT_THROW(BoxTable{std::span<const LightMap>{}}, InputError);
}

TEST(SplitPositions, LieStrictlyInside) {
  for (auto mode : {EstimateMode::paper, EstimateMode::refined})
    for (int length = 1; length < 40; ++length)
      for (const int p : split_positions(5, 5 + length, mode)) {
        EXPECT_GT(p, 5);
        EXPECT_LT(p, 5 + length);
      }
  EXPECT_TRUE(split_positions(3, 4, EstimateMode::refined).empty());
  EXPECT_EQ(split_positions(0, 96, EstimateMode::paper), std::vector<int>{48});
  EXPECT_EQ(split_positions(0, 96, EstimateMode::refined), (std::vector<int>{32, 48, 64}));
  EXPECT_EQ(split_positions(0, 2, EstimateMode::refined), std::vector<int>{1});
}

TEST(KernelCache, DirectionsSpanWhatTheHalvesSpan) {
  const auto lights = test::random_lights(30, 24, 18, 6);
  const BoxTable table(lights);
  const SmoothSpace none(table);
  KernelCache cache(table, none, EstimateMode::refined);
  const Box root{0, 0, 24, 18};
  const auto parent = cache.column(root);
  std::vector<float> half(3 * table.stride());
  ASSERT_EQ(cache.splits(root).size(), 6u);
  for (Split& split : cache.splits(root)) {
    EXPECT_EQ(split.first.area() + split.second.area(), root.area());
    table.column(split.first, half.data());
    for (int c = 0; c < 3; ++c) {
      double with_parent = 0.0, norm2 = 0.0;
      EXPECT_EQ(split.direction[c], nullptr);
      cache.make(split, c);
      for (int j = 0; j < 30; ++j) {
        const float d = split.direction[c][j], p = parent[c][j];
        EXPECT_NEAR(d + split.fraction[c] * p, half[c * table.stride() + j], 1e-5 * p);
        with_parent += static_cast<double>(d) * p;
        norm2 += static_cast<double>(p) * p;
      }
      EXPECT_NEAR(with_parent / norm2, 0.0, 1e-6);
    }
  }
  cache.clear();
  EXPECT_EQ(cache.bytes(), 0u);
}

}  // namespace
}  // namespace refield
