// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/field_light.h"

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

TEST(Zonal, ACapsEdgeIsHalfWayWhereHarmonicsResolveItAndLowWhereTheyDoNot) {
  const CapEdges edges(8);
  // Of half the sphere the edge is at one half: all its bands but the first are odd.
  EXPECT_NEAR(edges.at(0.5f).value, 0.5f, 2e-3f);
  EXPECT_GT(edges.at(0.5f).slope, 1.0f);
  // Of next to nothing the blurred function is flat: its solid angle times n²/4π, the sum of all y².
  EXPECT_NEAR(edges.at(1e-3f).value, 1e-3f * 64.0f, 4e-3f);
  EXPECT_EQ(edges.at(0.0f).value, 0.0f);
  EXPECT_NEAR(edges.at(1.0f).value, 1.0f, 1e-3f);
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
