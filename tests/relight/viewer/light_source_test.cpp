// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/field/light_painter.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <numeric>

#include "core/light/cube_map.h"
#include "relight/relight.h"
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

PaintedLight random_light_source(Rng& rng) {
  PaintedLight light_source;
  light_source.shape = rng.below(2) == 0 ? PaintedLight::Shape::bar : PaintedLight::Shape::spot;
  light_source.x = rng.uniform();
  light_source.y = rng.uniform();
  light_source.size = rng.uniform(0.0, 0.4);
  light_source.radiance = rng.uniform(0.1, 3.0);
  for (float& c : light_source.colour) c = static_cast<float>(rng.uniform());
  return light_source;
}

TEST(PaintedLight, PaintsInPartsWhatItPaintsAtOnce) {
  Rng rng{2};
  for (const LightDomain& domain : {monitor, sphere, LightDomain{10, 60, Parameterisation::cube}})
    for (int i = 0; i < 200; ++i) {
      const PaintedLight light_source = random_light_source(rng);
      const auto box = light_source_box(light_source, domain);
      ASSERT_TRUE(box && box->inside(domain.width, domain.height));
      LightMap at_once = dark(domain), in_parts = dark(domain);
      add_light_source(light_source, all_of(domain), at_once);
      add_light_source(light_source, {0, 0, domain.width / 2, domain.height}, in_parts);
      add_light_source(light_source, {domain.width / 2, 0, domain.width, domain.height}, in_parts);
      ASSERT_EQ(at_once.radiance.values, in_parts.radiance.values);
    }
}

TEST(PaintedLight, BarIsTheSequencesBar) {
  PaintedLight bar;
  bar.shape = PaintedLight::Shape::bar;
  bar.size = 0.125;
  bar.x = 0.5 * bar.size + 0.3 * (1.0 - bar.size);
  LightMap light = dark(monitor);
  add_light_source(bar, all_of(monitor), light);
  const LightMap expected = sliding_bar(monitor, 0.125, 3, 11);
  for (std::size_t i = 0; i < light.radiance.values.size(); ++i)
    ASSERT_NEAR(light.radiance.values[i], expected.radiance.values[i], 1e-5);
}

TEST(PaintedLight, MovingSmoothlyKeepsItsLight) {
  PaintedLight spot;
  spot.size = 0.2;
  const double area = std::numbers::pi * std::pow(spot.size * monitor.height, 2);
  for (double x = 0.4; x < 0.5; x += 0.003) {
    spot.x = x;
    LightMap light = dark(monitor);
    add_light_source(spot, all_of(monitor), light);
    const double sum = std::accumulate(light.radiance.values.begin(), light.radiance.values.end(), 0.0) / 3.0;
    EXPECT_NEAR(sum, area, 0.02 * area) << x;
  }
}

// From inside, a spot is a disc of the same solid angle wherever it stands, over the map's edge and at the
// poles, too.
TEST(PaintedLight, SpotOnTheSphereKeepsItsSolidAngle) {
  const auto solid_angle = [](double x, double y) {
    PaintedLight spot;
    spot.size = 0.2;
    spot.x = x;
    spot.y = y;
    LightMap light = dark(sphere);
    add_light_source(spot, all_of(sphere), light);
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
TEST(PaintedLight, SpotOnACubeKeepsItsSolidAngleAndItsBox) {
  constexpr int side = 40;
  const LightDomain cube = cube_domain(side);
  Rng rng{3};
  for (int i = 0; i < 60; ++i) {
    PaintedLight spot;
    spot.size = rng.uniform(0.05, 0.3);
    spot.x = rng.uniform();
    spot.y = rng.uniform();
    LightMap light = dark(cube);
    add_light_source(spot, all_of(cube), light);
    const auto box = light_source_box(spot, cube);
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
    LightSetup setup(domain);
    LightPainter painter(domain);
    setup.ambient = 0.1;
    setup.set_map(test::random_light(rng, domain));
    for (int i = 0; i < 3; ++i) setup.light_sources.push_back(random_light_source(rng));
    painter.paint(setup);
    for (int i = 0; i < 100; ++i) {
      const LightMap before = painter.light();
      setup.light_sources[rng.below(3)] = random_light_source(rng);
      const auto changed = painter.paint(setup);
      ASSERT_TRUE(changed);
      ASSERT_FALSE(painter.paint(setup));
      for (int y = 0; y < domain.height; ++y)
        for (int x = 0; x < domain.width; ++x)
          for (int c = 0; c < 3; ++c) {
            if (changed->contains(x, y)) continue;
            ASSERT_EQ(painter.light().radiance.at(x, y, c), before.radiance.at(x, y, c));
          }
    }
    // Light sources that come and go, too; as if it had been painted so at once.
    setup.light_sources.erase(setup.light_sources.begin() + 1);
    painter.paint(setup);
    setup.light_sources.push_back(random_light_source(rng));
    setup.ambient = 0.0;
    setup.set_map(std::nullopt);
    painter.paint(setup);
    LightPainter anew(domain);
    anew.paint(setup);
    EXPECT_EQ(painter.light().radiance.values, anew.light().radiance.values);
  }
}

TEST(LightPainter, EnvironmentsAreSeenThroughAMonitorsWindow) {
  Rng rng{7};
  const LightMap environment = test::random_light(rng, {64, 32, Parameterisation::lat_long});
  const MonitorPlacement placement{.width_mm = 520.0, .height_mm = 320.0, .distance_mm = 400.0};
  const auto projector = std::make_shared<const EnvironmentProjector>(monitor, std::span(&placement, 1));
  LightSetup setup(monitor);
  LightPainter painter(monitor);
  setup.environment = std::make_shared<const PreparedEnvironment>(environment);
  setup.projector = projector;
  for (const double turns : {0.0, 0.25, 0.0}) {
    setup.set_turns(turns);
    painter.paint(setup);
    const EnvironmentLight expected = projector->project(environment, {.yaw = 360.0 * turns});
    EXPECT_EQ(painter.light().radiance.values, expected.light.radiance.values) << turns;
    EXPECT_EQ(painter.share().energy, expected.share.energy) << turns;
  }
  EXPECT_LT(painter.share().energy, 0.3);
  setup.set_map(std::nullopt);
  painter.paint(setup);
  EXPECT_FALSE(setup.can_turn());
  EXPECT_EQ(painter.share().energy, 1.0);
}

TEST(LightPainter, TurnsItsMapAndFindsItsPaintedLights) {
  Rng rng{9};
  LightSetup setup(sphere);
  LightPainter painter(sphere);
  const LightMap map = test::random_light(rng, sphere);
  setup.set_map(map);
  setup.set_turns(1.25);
  EXPECT_NEAR(setup.turns, 0.25, 1e-12);
  painter.paint(setup);
  EXPECT_EQ(painter.light().radiance.values, rotated(map, 0.25).radiance.values);
  setup.set_turns(0.0);
  painter.paint(setup);
  EXPECT_EQ(painter.light().radiance.values, map.radiance.values);
  PaintedLight low, high;
  low.x = 0.3;
  high.x = 0.32;
  setup.light_sources.push_back(low);
  setup.light_sources.push_back(high);
  EXPECT_EQ(setup.light_source_at(0.31, 0.5), 1U);
  setup.light_sources.erase(setup.light_sources.begin() + 1);
  EXPECT_EQ(setup.light_source_at(0.31, 0.5), 0U);
  EXPECT_FALSE(setup.light_source_at(0.9, 0.5));
  EXPECT_THROW(setup.set_map(test::random_light(rng, monitor)), std::exception);
}

// A map that was turned for a setup which was given up before it was painted leaves nothing behind.
TEST(LightPainter, ForgetsMapsThatWereTurnedInVain) {
  Rng rng{10};
  LightSetup setup(sphere), other(sphere);
  LightPainter painter(sphere);
  setup.set_map(test::random_light(rng, sphere));
  other = setup;
  other.set_turns(0.5);
  painter.paint(setup);
  const std::vector<float> expected = painter.light().radiance.values;
  painter.turn_map(other);
  PaintedLight light_source;
  setup.light_sources.push_back(light_source);
  painter.paint(setup);
  setup.light_sources.clear();
  painter.paint(setup);
  EXPECT_EQ(painter.light().radiance.values, expected);
}

}  // namespace
}  // namespace refield
