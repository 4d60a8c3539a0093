// SPDX-License-Identifier: Apache-2.0
#include "core/image/metrics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "core/base/errors.h"
#include "tests/support/random_data.h"
#include "tests/support/series_error.h"

namespace refield {
namespace {

constexpr double rounding = 1e-6;  // float images, sums in double
constexpr float unmeasured = std::numeric_limits<float>::infinity();

Image scaled(Image image, float factor) {
  for (float& value : image.values) value *= factor;
  return image;
}

Image filled(std::initializer_list<float> pixels) {
  Image image(static_cast<int>(pixels.size()), 1, 1);
  image.values = pixels;
  return image;
}

TEST(RelativeRmse, KnownValue) {
  // sqrt((1² + 0² + 2²) / (3² + 4² + 0²)) = sqrt(5) / 5
  EXPECT_NEAR(relative_rmse(filled({2, 4, 2}), filled({3, 4, 0})), std::sqrt(5.0) / 5.0, rounding);
}

TEST(RelativeRmse, ErrorOfAScaledImageIsTheScale) {
  Rng rng(1);
  const Image observed = test::random_image(rng, 13, 7, 3);
  EXPECT_NEAR(relative_rmse(scaled(observed, 1.25f), observed), 0.25, rounding);
}

TEST(RelativeRmse, DoesNotChangeWithExposure) {
  Rng rng(2);
  const Image predicted = test::random_image(rng, 13, 7, 3);
  const Image observed = test::random_image(rng, 13, 7, 3);
  const double expected = relative_rmse(predicted, observed);
  EXPECT_NEAR(relative_rmse(scaled(predicted, 1024.0f), scaled(observed, 1024.0f)), expected, rounding);
}

TEST(RelativeRmse, BlackObserved) {
  const Image black(2, 2, 3);
  EXPECT_EQ(relative_rmse(black, black), 0.0);
  EXPECT_EQ(relative_rmse(Image(2, 2, 3, 0.1f), black), std::numeric_limits<double>::infinity());
}

TEST(RelativeRmse, PoolsImagesRatherThanAveragingThem) {
  const std::vector<Image> observed = {filled({10}), filled({1})};
  const std::vector<Image> predicted = {filled({10}), filled({2})};
  EXPECT_NEAR(relative_rmse(predicted, observed), std::sqrt(1.0 / 101.0), rounding);
}

TEST(RelativeRmse, MaskedPixelsDoNotCount) {
  const Mask mask = {1, 0, 1};
  EXPECT_NEAR(relative_rmse(filled({2, 1e6f, 2}), filled({3, 4, 0}), mask), std::sqrt(5.0) / 3.0, rounding);
  const Image map = relative_rmse_map(std::vector{filled({2, 9, 2})}, std::vector{filled({4, 4, 4})}, mask);
  EXPECT_EQ(map.values, (std::vector<float>{0.5f, 0.0f, 0.5f}));
}

TEST(RelativeRmse, MapIsTheErrorOfEachPixelOverImages) {
  const std::vector<Image> observed = {filled({1, 2}), filled({2, 0})};
  const std::vector<Image> predicted = {filled({1, 3}), filled({0, 0})};
  const Image map = relative_rmse_map(predicted, observed);
  EXPECT_NEAR(map.values[0], std::sqrt(4.0 / 5.0), rounding);
  EXPECT_NEAR(map.values[1], 0.5, rounding);
}

TEST(RelativeRmse, ShapesMustAgree) {
  EXPECT_THROW(relative_rmse(Image(2, 2, 3), Image(2, 3, 3)), InputError);
  EXPECT_THROW(relative_rmse(Image(2, 2, 3), Image(2, 2, 1)), InputError);
  EXPECT_THROW(relative_rmse(Image(2, 2, 3), Image(2, 2, 3), Mask(3)), InputError);
  EXPECT_THROW(relative_rmse(std::vector{Image(1, 1, 1)}, std::vector<Image>{}), InputError);
}

TEST(SeriesError, RefusesImagesThatDifferInSize) {
  SeriesError series;
  series.add(Image(2, 2, 3), Image(2, 2, 3));
  EXPECT_THROW(series.add(Image(2, 3, 3), Image(2, 3, 3)), InputError);
}

TEST(SeriesError, LeavesOutSamplesThatWereNotMeasured) {
  SeriesError series;
  series.add(filled({2, 100}), filled({4, 5}), filled({0.1f, unmeasured}));
  EXPECT_NEAR(series.relative_rmse(), 0.5, rounding);
}

TEST(RankCorrelation, LooksAtOrderAlone) {
  const std::vector<float> rising = {1, 2, 3, 4}, cubes = {1, 8, 27, 64}, falling = {4, 3, 2, 1};
  EXPECT_NEAR(rank_correlation(rising, cubes), 1.0, 1e-12);
  EXPECT_NEAR(rank_correlation(rising, falling), -1.0, 1e-12);
  // Ranks 0 2 1 3 against 0 1 2 3: 1 − 6 Σd² / (n (n² − 1)) = 0.8.
  EXPECT_NEAR(rank_correlation(rising, std::vector<float>{1, 3, 2, 4}), 0.8, 1e-12);
  // Equal values share their mean rank: 0 1.5 1.5 3.
  EXPECT_NEAR(rank_correlation(rising, std::vector<float>{1, 2, 2, 3}), 4.5 / std::sqrt(5.0 * 4.5), 1e-12);
  EXPECT_TRUE(std::isnan(rank_correlation(rising, std::vector<float>(4, 1.0f))));
  EXPECT_THROW(rank_correlation(rising, std::vector<float>(3)), InputError);
}

TEST(Quantile, InterpolatesBetweenOrderStatistics) {
  const std::vector<float> values = {4, 1, 3, 2};
  EXPECT_EQ(quantile(values, 0.0), 1.0);
  EXPECT_EQ(quantile(values, 0.5), 2.5);
  EXPECT_EQ(quantile(values, 1.0), 4.0);
  EXPECT_NEAR(quantile(values, 0.9), 3.7, rounding);
  EXPECT_TRUE(std::isnan(quantile({}, 0.5)));
}

TEST(Quantile, TakesOnlyPixelsOfTheMask) {
  EXPECT_EQ(values_in_mask(filled({1, 2, 3}), {0, 1, 1}), (std::vector<float>{2, 3}));
  EXPECT_EQ(values_in_mask(filled({1, 2, 3}), {}).size(), 3u);
}

}  // namespace
}  // namespace refield
