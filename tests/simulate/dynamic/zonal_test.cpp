// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/dynamic_light.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace refield::dynamic {
namespace {

TEST(Zonal, TablesInterpolateAndEndAtTheirEnds) {
  const ZonalTable table({0.0f, 1.0f, 4.0f});
  EXPECT_FLOAT_EQ(table(-1.0f), 0.0f);
  EXPECT_FLOAT_EQ(table(0.5f), 2.5f);
  EXPECT_FLOAT_EQ(table(1.0f), 4.0f);
  EXPECT_FLOAT_EQ(table(1.5f), 4.0f);
}

TEST(Zonal, TheFirstTermOfADiffuseSurfaceIsTheCosine) {
  const FirstTerm first = first_term(factor(Brdf{}, {}), 3);
  const float top = first.exact(1.0f);
  EXPECT_GT(top, 0.0f);
  for (const float z : {-0.5f, 0.0f, 0.3f, 0.8f}) {
    EXPECT_NEAR(first.exact(z) / top, std::max(z, 0.0f), 2e-3f);
    // Clamped cosine below the third order: 1/4 + z/2 + (5/32)(3 z² − 1).
    EXPECT_NEAR(first.by_harmonics(z) / top, 0.25f + 0.5f * z + 5.0f / 32.0f * (3.0f * z * z - 1.0f), 2e-3f);
  }
}

}  // namespace
}  // namespace refield::dynamic
