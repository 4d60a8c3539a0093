// SPDX-License-Identifier: Apache-2.0
#include "relight/relight.h"

#include <gtest/gtest.h>

#include <numeric>

#include "core/base/errors.h"
#include "tests/support/random_data.h"

namespace refield {
namespace {

constexpr LightDomain monitor{20, 3, Parameterisation::monitor};
constexpr LightDomain lat_long{20, 3, Parameterisation::lat_long};
constexpr double rounding = 1e-5;

double total(const LightMap& light) {
  return std::accumulate(light.radiance.values.begin(), light.radiance.values.end(), 0.0);
}

TEST(SlidingBar, GoesFromEdgeToEdgeOfAMonitor) {
  const LightMap first = sliding_bar(monitor, 0.25, 0, 4, 2.0f);
  const LightMap last = sliding_bar(monitor, 0.25, 3, 4, 2.0f);
  for (int x = 0; x < monitor.width; ++x) {
    EXPECT_EQ(first.radiance.at(x, 1, 0), x < 5 ? 2.0f : 0.0f);
    EXPECT_EQ(last.radiance.at(x, 1, 0), x >= 15 ? 2.0f : 0.0f);
  }
}

TEST(SlidingBar, EmitsTheSameLightInEveryFrame) {
  for (const LightDomain& domain : {monitor, lat_long})
    for (int i = 0; i < 37; ++i)
      EXPECT_NEAR(total(sliding_bar(domain, 0.13, i, 37)), 0.13 * 20 * 3 * 3, 1e-4) << "frame " << i;
}

TEST(SlidingBar, WrapsAroundALatLongMap) {
  const LightMap light = sliding_bar(lat_long, 0.25, 9, 10);  // starts at column 18
  for (int x = 0; x < lat_long.width; ++x)
    EXPECT_EQ(light.radiance.at(x, 0, 0), x >= 18 || x < 3 ? 1.0f : 0.0f) << x;
}

TEST(SlidingBar, ChecksItsArguments) {
  EXPECT_THROW(sliding_bar(monitor, 0.0, 0, 1), InputError);
  EXPECT_THROW(sliding_bar(monitor, 1.1, 0, 1), InputError);
  EXPECT_THROW(sliding_bar(monitor, 0.5, 4, 4), InputError);
  EXPECT_THROW(sliding_bar(monitor, 0.5, 0, 0), InputError);
}

TEST(Rotated, ByWholeColumnsMovesContentToTheRight) {
  Rng rng(1);
  const LightMap light = test::random_light(rng, lat_long);
  const LightMap turned = rotated(light, 0.25);
  for (int x = 0; x < 20; ++x)
    for (int c = 0; c < 3; ++c) EXPECT_EQ(turned.radiance.at((x + 5) % 20, 1, c), light.radiance.at(x, 1, c));
}

TEST(Rotated, AFullTurnChangesNothingAndFractionsKeepTheLight) {
  Rng rng(2);
  const LightMap light = test::random_light(rng, lat_long);
  EXPECT_EQ(rotated(light, 1.0).radiance.values, light.radiance.values);
  EXPECT_EQ(rotated(light, -2.0).radiance.values, light.radiance.values);
  EXPECT_NEAR(total(rotated(light, 0.333)), total(light), rounding * total(light));
  EXPECT_THROW(rotated(LightMap{light.radiance, Parameterisation::monitor}, 0.1), InputError);
}

}  // namespace
}  // namespace refield
