// SPDX-License-Identifier: Apache-2.0
#include "relight/environment/environment.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/base/errors.h"

namespace refield {
namespace {

constexpr double pi = std::numbers::pi;

/// Radiance times solid angle of what lies within `radius` of the sun.
double energy_near(const LightMap& sky, const Eigen::Vector3d& sun, double radius, int channel) {
  const Image& map = sky.radiance;
  double sum = 0.0;
  for (int y = 0; y < map.height; ++y)
    for (int x = 0; x < map.width; ++x)
      if (lat_long_direction(x + 0.5, y + 0.5, map.width, map.height).dot(sun) > std::cos(radius))
        sum += map.at(x, y, channel) * 2.0 * pi / map.width *
               (std::cos(pi * y / map.height) - std::cos(pi * (y + 1) / map.height));
  return sum;
}

Eigen::Array3d colour_at(const LightMap& sky, const Eigen::Vector3d& direction) {
  const Eigen::Vector2d at =
      lat_long_position(direction.normalized(), sky.radiance.width, sky.radiance.height);
  const int x = static_cast<int>(at.x()), y = static_cast<int>(at.y());
  return {sky.radiance.at(x, y, 0), sky.radiance.at(x, y, 1), sky.radiance.at(x, y, 2)};
}

TEST(Sky, TheSunRisesInTheEastAndCulminatesInTheSouth) {
  const SkyOptions options{.latitude_degrees = 40};
  EXPECT_NEAR((sun_direction(0.0, options) - Eigen::Vector3d(-1, 0, 0)).norm(), 0.0, 1e-12);
  EXPECT_NEAR((sun_direction(1.0, options) - Eigen::Vector3d(1, 0, 0)).norm(), 0.0, 1e-12);
  const Eigen::Vector3d noon = sun_direction(0.5, options);
  EXPECT_NEAR(std::asin(noon.y()), 50.0 * pi / 180.0, 1e-12);
  EXPECT_GT(noon.z(), 0.0);
}

TEST(Sky, TheSunHasTheSameEnergyInMapsOfAnySize) {
  const Eigen::Vector3d sun = sun_direction(0.37, {});
  const double fine = energy_near(clear_sky(sun, {.width = 2048}), sun, 0.15, 1);
  EXPECT_GT(fine, 60.0);  // klx: most of a sun that has lost some of its 128 to the air
  EXPECT_LT(fine, 128.0);
  for (const int width : {64, 128, 512, 1024})
    EXPECT_NEAR(energy_near(clear_sky(sun, {.width = width}), sun, 0.15, 1) / fine, 1.0, 0.02) << width;
}

TEST(Sky, IsBlueByDayAndItsSunRedAtItsRising) {
  const LightMap noon = clear_sky(sun_direction(0.5, {}), {.width = 256});
  const Eigen::Array3d zenith = colour_at(noon, {0.01, 1, -0.01});
  EXPECT_GT(zenith[2], 1.5 * zenith[0]);
  const Eigen::Vector3d low = sun_direction(0.03, {});
  const LightMap morning = clear_sky(low, {.width = 256});
  EXPECT_GT(energy_near(morning, low, 0.05, 0), 2.0 * energy_near(morning, low, 0.05, 2));
  for (const LightMap& sky : {noon, morning})
    EXPECT_TRUE(
        std::ranges::all_of(sky.radiance.values, [](float v) { return std::isfinite(v) && v >= 0.0f; }));
}

TEST(Sky, ChecksItsOptions) {
  EXPECT_THROW(clear_sky({0, 1, 0}, {.turbidity = 1.0}), InputError);
  EXPECT_THROW(clear_sky({0, 1, 0}, {.width = 33}), InputError);
  EXPECT_THROW(sun_direction(0.5, {.latitude_degrees = 90}), InputError);
}

}  // namespace
}  // namespace refield
