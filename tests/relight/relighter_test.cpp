// SPDX-License-Identifier: Apache-2.0
#include "relight/relighter.h"

#include <gtest/gtest.h>

#include <hwy/targets.h>
#include <tbb/global_control.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <tuple>
#include <utility>

#include "core/base/errors.h"
#include "core/base/rng.h"
#include "core/field/field_statistics.h"
#include "core/image/metrics.h"
#include "tests/relight/mixed_field.h"
#include "tests/support/random_data.h"

namespace refield {
namespace {

using test::mixed_field;

constexpr double fast_error = 1e-3;  // what RelightPrecision promises
constexpr double fine_error = 1e-5;

LightMap random_light(const LightDomain& domain, std::uint64_t seed) {
  Rng rng(seed);
  return test::random_light(rng, domain);
}

constexpr LightDomain monitor{50, 40, Parameterisation::monitor};

class RelighterOfSize : public testing::TestWithParam<std::tuple<int, int>> {};

TEST_P(RelighterOfSize, EqualsTheFieldUpToItsPrecision) {
  const auto [width, height] = GetParam();
  const ReflectanceField field = mixed_field(width, height, monitor);
  const LightMap light = random_light(monitor, 1);
  const Image expected = field.relight(light);
  TileRelighter fast(field), fine(field, RelightPrecision::fine);
  EXPECT_LT(relative_rmse(fast.relight(light), expected), fast_error);
  EXPECT_LT(relative_rmse(fine.relight(light), expected), fine_error);
}

// Whole tiles, cut tiles, less than a group, a row of vertices.
INSTANTIATE_TEST_SUITE_P(Sizes, RelighterOfSize,
                         testing::Values(std::tuple(64, 48), std::tuple(37, 29), std::tuple(3, 2),
                                         std::tuple(1, 1), std::tuple(101, 1), std::tuple(1, 33)));

TEST(TileRelighter, GivesTheSameOnEveryInstructionSet) {
  const ReflectanceField field = mixed_field(37, 29, monitor);
  const LightMap light = random_light(monitor, 1), other = random_light(monitor, 2);
  TileRelighter reference(field);
  const Image whole = reference.relight(light);
  LightMap changed = light;
  const Box part = {10, 5, 22, 31};
  for (int y = part.y0; y < part.y1; ++y)
    for (int x = part.x0; x < part.x1; ++x)
      for (int c = 0; c < 3; ++c) changed.radiance.at(x, y, c) = other.radiance.at(x, y, c);
  const Image updated = reference.update(changed, part);
  int tried = 0;
  for (std::int64_t left = hwy::SupportedTargets(); left != 0; left &= left - 1, ++tried) {
    const std::int64_t target = left & -left;
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(target);
    TileRelighter relighter(field);
    // Only the order of roundings in float may differ.
    EXPECT_LT(relative_rmse(relighter.relight(light), whole), 1e-6) << hwy::TargetName(target);
    EXPECT_LT(relative_rmse(relighter.update(changed, part), updated), 1e-6) << hwy::TargetName(target);
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().DeInit();
  EXPECT_GT(tried, 0);
}

TEST(TileRelighter, InterpolatesBetweenLightSources) {
  ReflectanceField field = mixed_field(37, 29, {50, 25, Parameterisation::lat_long});
  for (int x = 0; x < 50; x += 4) field.observed_light.push_back({x, x % 7 + 8, x + 1, x % 7 + 9});
  field.basis.interpolation = LightInterpolation{field.observed_light, 0.8, 0.1, 0.1, 0.5};
  const LightMap light = random_light(field.basis.domain, 1);
  const Image expected = field.relight(light);
  TileRelighter fast(field), fine(field, RelightPrecision::fine);
  // Of the sources' light, part of which is negative; relative to the picture this is more.
  EXPECT_LT(relative_rmse(fast.relight(light), expected), 3 * fast_error);
  EXPECT_LT(relative_rmse(fine.relight(light), expected), 3 * fine_error);
  // A texel that changes has an effect on the light of many sources.
  LightMap changed = light;
  const Box part{20, 10, 22, 12};
  for (int y = part.y0; y < part.y1; ++y)
    for (int x = part.x0; x < part.x1; ++x) changed.radiance.at(x, y, 1) += 20.0f;
  EXPECT_LT(relative_rmse(fine.update(changed, part), field.relight(changed)), 3 * fine_error);
}

TEST(TileRelighter, UsesUpAFieldThatIsGivenUp) {
  const ReflectanceField field = mixed_field(70, 131, monitor);  // several bands of tiles
  const LightMap light = random_light(monitor, 1);
  ReflectanceField given = field;
  TileRelighter relighter(std::move(given));
  EXPECT_EQ(relighter.relight(light).values, TileRelighter(field).relight(light).values);
  EXPECT_EQ(given.transfer.entries(), 0u);
  EXPECT_EQ(given.basis.size(), field.basis.size());
}

// Memory is kept from one light to the next, and tiles prefetch their successors.
TEST(TileRelighter, ShowsALightTheSameWhateverCameBeforeAndOnOneThread) {
  const ReflectanceField field = mixed_field(101, 133, monitor);
  const LightMap light = random_light(monitor, 1), other = random_light(monitor, 2);
  for (const auto precision : {RelightPrecision::fast, RelightPrecision::fine}) {
    const Image expected = TileRelighter(field, precision).relight(light);
    TileRelighter relighter(field, precision);
    relighter.relight(other);
    EXPECT_EQ(relighter.relight(light).values, expected.values);
    const tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);
    EXPECT_EQ(relighter.relight(light).values, expected.values);
  }
}

// The projection takes texels in pairs; intervals between nodes have odd and even lengths here.
TEST(TileRelighter, SumsHatsOverMapsOfAnyWidth) {
  const HatGrid hats{5, 4};
  for (const int width : {49, 50, 51, 53}) {
    const LightMap light = random_light({width, 7, Parameterisation::monitor}, 6);
    const std::vector<double> sums = hats.project(light);
    for (int node = 0; node < hats.count(); ++node)
      for (int c = 0; c < 3; ++c) {
        double expected = 0.0;
        for (int y = 0; y < 7; ++y)
          for (int x = 0; x < width; ++x)
            expected += double{hats.value(node, x, y, light.domain())} * light.radiance.at(x, y, c);
        // HatGrid::value() rounds to float.
        EXPECT_NEAR(sums[static_cast<std::size_t>(3 * node + c)], expected, 1e-5) << width << ' ' << node;
      }
  }
}

// Other programs' files may name a kernel twice in a row.
TEST(TileRelighter, AddsUpAKernelThatAPixelHasTwice) {
  ReflectanceField field;
  field.width = field.height = 4;
  field.basis = {monitor, {}, {{0, 0, 20, 20}, {5, 5, 9, 30}}};
  for (int i = 0; i < 16; ++i)
    field.transfer.append_row(std::vector<std::uint32_t>{0, 1, 0},
                              std::vector<float>(9, 0.01f * static_cast<float>(i + 1)));
  const LightMap light = random_light(monitor, 1);
  TileRelighter relighter(field, RelightPrecision::fine);
  EXPECT_LT(relative_rmse(relighter.relight(light), field.relight(light)), fine_error);
}

// As ridge regression or wavelets give them. Pixels below zero stay: pictures for screens clip them.
TEST(TileRelighter, ShowsWeightsOfBothSigns) {
  const ReflectanceField field = test::with_both_signs(mixed_field(37, 29, monitor));
  LightMap light = random_light(monitor, 1);
  const Image expected = field.relight(light);
  ASSERT_LT(*std::ranges::min_element(expected.values), 0.0f);
  TileRelighter relighter(field), given_up{ReflectanceField(field)};
  EXPECT_LT(relative_rmse(relighter.relight(light), expected), fine_error);
  EXPECT_EQ(given_up.relight(light).values, relighter.relight(light).values);
  const Box part = {10, 5, 22, 31};
  for (int y = part.y0; y < part.y1; ++y)
    for (int x = part.x0; x < part.x1; ++x) light.radiance.at(x, y, 1) *= 3.0f;
  EXPECT_LT(relative_rmse(relighter.update(light, part), field.relight(light)), fine_error);
}

TEST(TileRelighter, RefusesLightThatIsNotFinite) {
  const ReflectanceField field = mixed_field(20, 20, monitor);
  TileRelighter relighter(field, RelightPrecision::fine);
  const LightMap light = random_light(monitor, 5);
  const Image shown = relighter.relight(light);
  for (const float bad : {std::numeric_limits<float>::quiet_NaN(), -std::numeric_limits<float>::infinity()}) {
    LightMap damaged = light;
    damaged.radiance.at(7, 30, 1) = bad;
    EXPECT_THROW(relighter.update(damaged, {5, 29, 9, 32}), InputError);
    EXPECT_EQ(relighter.update(light, {0, 0, 1, 1}).values, shown.values) << "nothing was taken over";
    EXPECT_THROW(relighter.relight(damaged), InputError);
    EXPECT_EQ(relighter.update(light, {0, 0, 1, 1}).values, shown.values);
  }
}

TEST(TileRelighter, LightsNothingWithNoLight) {
  const ReflectanceField field = mixed_field(20, 20, monitor);
  const LightMap dark{Image(monitor.width, monitor.height, 3), monitor.parameterisation};
  for (const auto precision : {RelightPrecision::fast, RelightPrecision::fine}) {
    TileRelighter relighter(field, precision);
    for (const float value : relighter.relight(dark).values) EXPECT_EQ(value, 0.0f);
  }
}

TEST(TileRelighter, ShowsEverySingleTexel) {
  const ReflectanceField field = mixed_field(24, 20, monitor);
  TileRelighter relighter(field);
  for (const auto& [x, y] : {std::pair(0, 0), std::pair(49, 39), std::pair(0, 39), std::pair(23, 17)}) {
    LightMap light{Image(monitor.width, monitor.height, 3), monitor.parameterisation};
    for (int c = 0; c < 3; ++c) light.radiance.at(x, y, c) = 1e5f;
    EXPECT_LT(relative_rmse(relighter.relight(light), field.relight(light)), 3 * fast_error) << x << ' ' << y;
  }
}

TEST(TileRelighter, WorksWithoutHatsAndWithoutBoxes) {
  ReflectanceField no_hats = mixed_field(33, 17, monitor, {});
  const LightMap light = random_light(monitor, 4);
  EXPECT_LT(relative_rmse(TileRelighter(no_hats).relight(light), no_hats.relight(light)), fast_error);
  ReflectanceField only_hats;
  only_hats.width = only_hats.height = 5;
  only_hats.basis = {monitor, {3, 2}, {}};
  const std::vector<std::uint32_t> columns = {0, 1, 2, 3, 4, 5};
  const std::vector<float> weights(18, 0.25f);
  for (int i = 0; i < 25; ++i) only_hats.transfer.append_row(columns, weights);
  EXPECT_LT(relative_rmse(TileRelighter(only_hats).relight(light), only_hats.relight(light)), fast_error);
}

TEST(TileRelighter, UpdatesAsIfComputedAnew) {
  const ReflectanceField field = mixed_field(37, 29, monitor);
  for (const auto precision : {RelightPrecision::fast, RelightPrecision::fine}) {
    TileRelighter relighter(field, precision), anew(field, precision);
    LightMap light = random_light(monitor, 1);
    relighter.relight(light);
    Rng rng(5);
    // Past the period after which the image is computed as a whole.
    for (int step = 0; step < TileRelighter::refresh_period + 20; ++step) {
      const Box part = test::random_box(rng, monitor.width, monitor.height);
      for (int y = part.y0; y < part.y1; ++y)
        for (int x = part.x0; x < part.x1; ++x)
          for (int c = 0; c < 3; ++c) light.radiance.at(x, y, c) = static_cast<float>(rng.uniform());
      const Image& updated = relighter.update(light, part);
      if (step % 20 == 0 || step > TileRelighter::refresh_period - 3) {
        ASSERT_LT(relative_rmse(updated, anew.relight(light)), 5e-6) << "after " << step << " changes";
      }
    }
  }
}

TEST(TileRelighter, ForgetsASunThatSet) {
  const ReflectanceField field = mixed_field(37, 29, monitor);
  TileRelighter relighter(field, RelightPrecision::fine);
  LightMap light = random_light(monitor, 1);
  const Image before = relighter.relight(light);
  const Box sun = {20, 20, 21, 21};
  const float was = light.radiance.at(20, 20, 1);
  light.radiance.at(20, 20, 1) = 1e7f;  // much more than all other light together
  relighter.update(light, sun);
  light.radiance.at(20, 20, 1) = was;
  EXPECT_LT(relative_rmse(relighter.update(light, sun), before), 1e-6);
}

TEST(TileRelighter, TakesAChangeForTheWholeWhereItHasNoImageYet) {
  const ReflectanceField field = mixed_field(20, 20, monitor);
  const LightMap light = random_light(monitor, 1);
  TileRelighter relighter(field);
  EXPECT_LT(relative_rmse(relighter.update(light, {0, 0, 1, 1}), field.relight(light)), fast_error);
}

TEST(TileRelighter, KernelsInItsTilesAreThoseOfTheRows) {
  const ReflectanceField field = mixed_field(37, 21, monitor);
  const TileRelighter tiled(field, RelightPrecision::fine);
  const double step = *std::ranges::max_element(field.transfer.weight) / 65535.0;
  for (std::size_t p = 0; p < field.transfer.rows(); ++p) {
    const Image expected = kernel_density(field, p);
    const auto kernels = kernels_of_pixel(tiled.transfer(), field.basis, p);
    const Image density = kernel_density(field.basis, kernels);
    for (std::size_t i = 0; i < expected.values.size(); ++i)
      ASSERT_NEAR(density.values[i], expected.values[i], static_cast<double>(kernels.size() + 1) * step) << p;
  }
  EXPECT_THROW(kernels_of_pixel(tiled.transfer(), field.basis, 37 * 21), InputError);
}

TEST(TileRelighter, RefusesWhatDoesNotFit) {
  const ReflectanceField field = mixed_field(20, 20, monitor);
  TileRelighter relighter(field);
  const LightMap light = random_light(monitor, 1);
  EXPECT_THROW(relighter.relight(random_light({40, 40, Parameterisation::monitor}, 1)), InputError);
  EXPECT_THROW(relighter.relight(random_light({50, 40, Parameterisation::lat_long}, 1)), InputError);
  EXPECT_THROW(relighter.update(light, {0, 0, 51, 2}), InputError);
  EXPECT_THROW(relighter.update(light, {4, 4, 4, 8}), InputError);
  ReflectanceField wide = field;
  wide.basis.domain.width = small_box_limit + 1;
  EXPECT_THROW(TileRelighter{wide}, InputError);
}

// Above some million texels steps of whole numbers would be too coarse: sums are made in double there.
TEST(TileRelighter, KeepsDarkTexelsOfALargeMapBesideASun) {
  const LightDomain large{2048, 1024, Parameterisation::lat_long};
  ReflectanceField field;
  field.width = 2;
  field.height = 1;
  field.basis = {large, {}, {{5, 5, 6, 6}, {1000, 500, 1001, 501}}};
  for (std::uint32_t k = 0; k < 2; ++k)
    field.transfer.append_row(std::vector{k}, std::vector{1.0f, 1.0f, 1.0f});
  LightMap light = random_light(large, 3);
  for (int c = 0; c < 3; ++c) light.radiance.at(1000, 500, c) = 1e5f;
  const Image image = TileRelighter(field).relight(light);
  EXPECT_NEAR(image.at(0, 0, 1), light.radiance.at(5, 5, 1), 1e-5);
  EXPECT_NEAR(image.at(1, 0, 1), 1e5f, 1e-5 * 1e5);
}

}  // namespace
}  // namespace refield
