// SPDX-License-Identifier: Apache-2.0
#include "relight/tiles/box_sums.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/base/errors.h"
#include "core/base/rng.h"
#include "core/light/summed_area_table.h"
#include "tests/support/random_data.h"

namespace refield {
namespace {

/// Largest difference from a table in double over many boxes, in steps of the channel.
double worst_in_steps(const Image& light) {
  FixedPointTable table;
  table.build(light);
  const SummedAreaTable exact(light);
  Rng rng(2);
  double worst = 0.0;
  for (int i = 0; i < 500; ++i) {
    const Box from = test::random_box(rng, light.width, light.height);
    const SmallBox box = {static_cast<std::int16_t>(from.x0), static_cast<std::int16_t>(from.y0),
                          static_cast<std::int16_t>(from.x1), static_cast<std::int16_t>(from.y1)};
    float sum[4];
    table.sum(std::span(&box, 1), sum);
    const auto expected = exact.sum(from);
    for (std::size_t c = 0; c < 3; ++c) {
      // What float itself rounds off (number, step and product) is not the table's.
      const double slack = std::abs(expected[c]) * 1.8e-7;
      worst = std::max(worst, (std::abs(sum[c] - expected[c]) - slack) / table.step()[c]);
    }
  }
  return worst;
}

TEST(FixedPointTable, IsOffByTwoStepsAtMost) {
  Image light(150, 131, 3);
  Rng rng(1);
  for (float& value : light.values) value = static_cast<float>(rng.uniform());
  EXPECT_LE(worst_in_steps(light), 2.0);
  light.at(77, 64, 0) = 1e5f;
  light.at(149, 130, 1) = 1e5f;
  light.at(0, 0, 2) = 1e5f;
  EXPECT_LE(worst_in_steps(light), 2.0);
}

TEST(FixedPointTable, HoldsChangesThatCancel) {
  Image change(64, 70, 3);
  for (int c = 0; c < 3; ++c) {
    change.at(10, 10, c) = 1e6f;
    change.at(10, 11, c) = -1e6f;
    change.at(12, 69, c) = -1.0f;
  }
  EXPECT_LE(worst_in_steps(change), 2.0);
}

TEST(FixedPointTable, StepsAreTwoToTheMinus31OfAllLight) {
  Image light(100, 80, 3);
  light.values.assign(light.values.size(), 0.5f);
  FixedPointTable table;
  table.build(light);
  EXPECT_NEAR(table.step()[1] * std::pow(2.0, 31), 0.5 * 100 * 80, 0.01);
}

TEST(FixedPointTable, IsMadeAnewForEachLight) {
  FixedPointTable table;
  Image large(90, 90, 3), small(7, 5, 3);
  large.values.assign(large.values.size(), 3.0f);
  small.values.assign(small.values.size(), 1.0f);
  table.build(large);
  table.build(small);
  const SmallBox box = {1, 1, 4, 5};
  float sum[4];
  table.sum(std::span(&box, 1), sum);
  EXPECT_FLOAT_EQ(sum[0], 12.0f);
  EXPECT_THROW(table.build(Image(3, 3, 1)), InputError);
}

}  // namespace
}  // namespace refield
