// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/lamp.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <numeric>

#include "core/cube_map.h"
#include "relight/sequence.h"
#include "relight/viewer/light_painter.h"
#include "tests/support/random_data.h"

namespace refield {
namespace {

constexpr LightDomain monitor{60, 40, Parameterisation::monitor};
constexpr LightDomain sphere{72, 36, Parameterisation::lat_long};

LightMap dark(const LightDomain& domain) {
  return {Image(domain.width, domain.height, 3), domain.parameterisation};
}

Box all_of(const LightDomain& domain) {
  return {0, 0, domain.width, domain.height};
}

Lamp random_lamp(Rng& rng) {
  Lamp lamp;
  lamp.shape = rng.below(2) == 0 ? Lamp::Shape::bar : Lamp::Shape::spot;
  lamp.x = rng.uniform();
  lamp.y = rng.uniform();
  lamp.size = rng.uniform(0.0, 0.4);
  lamp.radiance = rng.uniform(0.1, 3.0);
  for (float& c : lamp.colour) c = static_cast<float>(rng.uniform());
  return lamp;
}

TEST(Lamp, PaintsInPartsWhatItPaintsAtOnce) {
  Rng rng{2};
  for (const LightDomain& domain : {monitor, sphere, LightDomain{10, 60, Parameterisation::cube}})
    for (int i = 0; i < 200; ++i) {
      const Lamp lamp = random_lamp(rng);
      const auto box = lamp_box(lamp, domain);
      ASSERT_TRUE(box && box->inside(domain.width, domain.height));
      LightMap at_once = dark(domain), in_parts = dark(domain);
      add_lamp(lamp, all_of(domain), at_once);
      add_lamp(lamp, {0, 0, domain.width / 2, domain.height}, in_parts);
      add_lamp(lamp, {domain.width / 2, 0, domain.width, domain.height}, in_parts);
      ASSERT_EQ(at_once.radiance.values, in_parts.radiance.values);
    }
}

TEST(Lamp, BarIsTheSequencesBar) {
  Lamp bar;
  bar.shape = Lamp::Shape::bar;
  bar.size = 0.125;
  bar.x = 0.5 * bar.size + 0.3 * (1.0 - bar.size);
  LightMap light = dark(monitor);
  add_lamp(bar, all_of(monitor), light);
  const LightMap expected = sliding_bar(monitor, 0.125, 3, 11);
  for (std::size_t i = 0; i < light.radiance.values.size(); ++i)
    ASSERT_NEAR(light.radiance.values[i], expected.radiance.values[i], 1e-5);
}

TEST(Lamp, MovingSmoothlyKeepsItsLight) {
  Lamp spot;
  spot.size = 0.2;
  const double area = std::numbers::pi * std::pow(spot.size * monitor.height, 2);
  for (double x = 0.4; x < 0.5; x += 0.003) {
    spot.x = x;
    LightMap light = dark(monitor);
    add_lamp(spot, all_of(monitor), light);
    const double sum = std::accumulate(light.radiance.values.begin(), light.radiance.values.end(), 0.0) / 3.0;
    EXPECT_NEAR(sum, area, 0.02 * area) << x;
  }
}

// From inside, a spot is a disc of the same solid angle wherever it stands, over the map's edge and at the
// poles, too.
TEST(Lamp, SpotOnTheSphereKeepsItsSolidAngle) {
  const auto solid_angle = [](double x, double y) {
    Lamp spot;
    spot.size = 0.2;
    spot.x = x;
    spot.y = y;
    LightMap light = dark(sphere);
    add_lamp(spot, all_of(sphere), light);
    double sum = 0.0;
    for (int row = 0; row < sphere.height; ++row)
      for (int column = 0; column < sphere.width; ++column)
        sum += light.radiance.at(column, row, 0) * std::sin(std::numbers::pi * (row + 0.5) / sphere.height);
    return sum * 2.0 * std::numbers::pi * std::numbers::pi / (sphere.width * sphere.height);
  };
  const double cap = 2.0 * std::numbers::pi * (1.0 - std::cos(0.2 * std::numbers::pi));
  for (const double y : {0.0, 0.1, 0.3, 0.5, 0.9})
    for (const double x : {0.0, 0.37, 0.98}) EXPECT_NEAR(solid_angle(x, y), cap, 0.03 * cap) << x << " " << y;
}

// Also on a cube, across its edges; and the texels that it names are all that it lights.
TEST(Lamp, SpotOnACubeKeepsItsSolidAngleAndItsBox) {
  constexpr int side = 40;
  const LightDomain cube = cube_domain(side);
  Rng rng{3};
  for (int i = 0; i < 60; ++i) {
    Lamp spot;
    spot.size = rng.uniform(0.05, 0.3);
    spot.x = rng.uniform();
    spot.y = rng.uniform();
    LightMap light = dark(cube);
    add_lamp(spot, all_of(cube), light);
    const auto box = lamp_box(spot, cube);
    double sum = 0.0;
    for (int y = 0; y < cube.height; ++y)
      for (int x = 0; x < side; ++x) {
        sum += light.radiance.at(x, y, 0) * cube_solid_angle(x, y, side);
        const Eigen::Vector3d towards = lat_long_direction(spot.x, spot.y, 1, 1);
        const double angle =
            std::acos(std::clamp(towards.dot(cube_direction(x + 0.5, y + 0.5, side)), -1.0, 1.0));
        if (angle < 0.9 * spot.size * std::numbers::pi) {
          ASSERT_TRUE(box->contains(x, y));
        }
      }
    const double cap = 2.0 * std::numbers::pi * (1.0 - std::cos(spot.size * std::numbers::pi));
    EXPECT_NEAR(sum, cap, 0.05 * cap);
  }
}

TEST(LightPainter, ChangesOnlyWhatItSays) {
  Rng rng{6};
  for (const LightDomain& domain : {monitor, sphere, cube_domain(12)}) {
    LightPainter painter(domain);
    painter.set_ambient(0.1);
    painter.set_map(test::random_light(rng, domain));
    for (int i = 0; i < 3; ++i) painter.add(random_lamp(rng));
    painter.take_changed();
    for (int i = 0; i < 100; ++i) {
      const LightMap before = painter.light();
      painter.change(rng.below(3), random_lamp(rng));
      const auto changed = painter.take_changed();
      ASSERT_TRUE(changed);
      ASSERT_FALSE(painter.take_changed());
      for (int y = 0; y < domain.height; ++y)
        for (int x = 0; x < domain.width; ++x)
          for (int c = 0; c < 3; ++c) {
            if (changed->contains(x, y)) continue;
            ASSERT_EQ(painter.light().radiance.at(x, y, c), before.radiance.at(x, y, c));
          }
    }
    // As if it had been painted so at once.
    LightPainter anew(domain);
    for (const Lamp& lamp : painter.lamps()) anew.add(lamp);
    LightMap expected = anew.light();
    painter.set_ambient(0.0);
    painter.set_map(std::nullopt);
    EXPECT_EQ(painter.light().radiance.values, expected.radiance.values);
  }
}

TEST(LightPainter, SurroundingsAreSeenThroughAMonitorsWindow) {
  Rng rng{7};
  const LightMap surroundings = test::random_light(rng, {64, 32, Parameterisation::lat_long});
  const MonitorPlacement placement{.width_mm = 520.0, .height_mm = 320.0, .distance_mm = 400.0};
  const auto projector = std::make_shared<const EnvironmentProjector>(monitor, std::span(&placement, 1));
  LightPainter painter(monitor);
  painter.set_surroundings(surroundings, projector);
  for (const double turns : {0.0, 0.25, 0.0}) {
    painter.set_turns(turns);
    const EnvironmentLight expected = projector->project(surroundings, {.yaw = 360.0 * turns});
    EXPECT_EQ(painter.light().radiance.values, expected.light.radiance.values) << turns;
    EXPECT_EQ(painter.share().energy, expected.share.energy) << turns;
  }
  EXPECT_LT(painter.share().energy, 0.3);
  painter.set_map(std::nullopt);
  EXPECT_FALSE(painter.can_turn());
  EXPECT_EQ(painter.share().energy, 1.0);
}

TEST(LightPainter, TurnsItsMapAndFindsItsLamps) {
  Rng rng{9};
  LightPainter painter(sphere);
  const LightMap map = test::random_light(rng, sphere);
  painter.set_map(map);
  painter.set_turns(1.25);
  EXPECT_NEAR(painter.turns(), 0.25, 1e-12);
  EXPECT_EQ(painter.light().radiance.values, rotated(map, 0.25).radiance.values);
  painter.set_turns(0.0);
  EXPECT_EQ(painter.light().radiance.values, map.radiance.values);
  Lamp low, high;
  low.x = 0.3;
  high.x = 0.32;
  painter.add(low);
  painter.add(high);
  EXPECT_EQ(painter.lamp_at(0.31, 0.5), 1U);
  painter.remove(1);
  EXPECT_EQ(painter.lamp_at(0.31, 0.5), 0U);
  EXPECT_FALSE(painter.lamp_at(0.9, 0.5));
  EXPECT_THROW(painter.set_map(test::random_light(rng, monitor)), std::exception);
}

}  // namespace
}  // namespace refield
