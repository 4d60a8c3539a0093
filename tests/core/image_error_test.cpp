// SPDX-License-Identifier: Apache-2.0
#include "core/image/metrics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "core/base/errors.h"
#include "core/image/tone_map.h"
#include "tests/support/random_data.h"

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

/// Dim values with one highlight, as photographs of glossy things are.
Image scene_with_highlight() {
  Rng rng(3);
  Image image = test::random_image(rng, 60, 40, 3, 0.02, 0.2);
  for (int c = 0; c < 3; ++c) image.at(7, 5, c) = 300.0f;
  return image;
}

TEST(ToneMappedPsnr, EqualImagesAreInfinitelyClose) {
  const Image image = scene_with_highlight();
  EXPECT_EQ(tone_mapped_psnr_db(image, image), std::numeric_limits<double>::infinity());
  EXPECT_EQ(tone_mapped_psnr_db(Image(2, 2, 3), Image(2, 2, 3)), std::numeric_limits<double>::infinity());
}

TEST(ToneMappedPsnr, KnownNoise) {
  // Values between a quarter and full white on the screen, noise of ±0.02 there: 20 log10(1 / 0.02) dB.
  Rng rng(4);
  Image observed(32, 32, 3), predicted(32, 32, 3);
  for (std::size_t i = 0; i < observed.values.size(); ++i) {
    const auto shown = static_cast<float>(rng.uniform(0.25, 0.9));
    observed.values[i] = linear_from_srgb(shown);
    predicted.values[i] = linear_from_srgb(shown + (i % 2 == 0 ? 0.02f : -0.02f));
  }
  for (int i = 0; i < 32; ++i)  // a row of white fixes the exposure at one
    for (int c = 0; c < 3; ++c) observed.at(i, 0, c) = predicted.at(i, 0, c) = 1.0f;
  const double noisy_share = 31.0 / 32.0;
  EXPECT_NEAR(tone_mapped_psnr_db(predicted, observed), -10.0 * std::log10(0.02 * 0.02 * noisy_share), 1e-3);
}

TEST(ToneMappedPsnr, AHighlightDoesNotHideAnError) {
  const Image observed = scene_with_highlight();
  const Image predicted = scaled(observed, 2.93f);
  EXPECT_NEAR(relative_rmse(predicted, observed), 1.93, 1e-3);
  // With the highlight as the peak this error would score 27 dB.
  double squares = 0.0;
  for (std::size_t i = 0; i < observed.values.size(); ++i)
    squares += std::pow(predicted.values[i] - observed.values[i], 2.0);
  const double rmse = std::sqrt(squares / static_cast<double>(observed.values.size()));
  ASSERT_GT(20.0 * std::log10(300.0 / rmse), 27.0);
  EXPECT_LT(tone_mapped_psnr_db(predicted, observed), 13.0);
}

TEST(ToneMappedPsnr, DoesNotChangeWithExposure) {
  const Image observed = scene_with_highlight();
  const Image predicted = scaled(observed, 1.1f);
  EXPECT_NEAR(tone_mapped_psnr_db(predicted, observed),
              tone_mapped_psnr_db(scaled(predicted, 64.0f), scaled(observed, 64.0f)), 1e-4);
}

TEST(ToneMappedPsnr, LeavesOutWhatIsMaskedOrWasNotMeasured) {
  const Image observed = filled({1, 0.5f, 0.25f}), predicted = filled({1, 0.5f, 9});
  EXPECT_EQ(tone_mapped_psnr_db(predicted, observed, {1, 1, 0}), std::numeric_limits<double>::infinity());
  EXPECT_EQ(tone_mapped_psnr_db(predicted, observed, {}, filled({0, 0, unmeasured})),
            std::numeric_limits<double>::infinity());
  EXPECT_LT(tone_mapped_psnr_db(predicted, observed), 20.0);
  EXPECT_THROW(tone_mapped_psnr_db(filled({1}), filled({1, 2})), InputError);
}

TEST(ToneMappedPsnr, OfASeriesIsThatOfTheMeanSquaredError) {
  const ImageError images[] = {{0.1, 20.0}, {0.2, 20.0}, {0.6, 10.0}};
  EXPECT_NEAR(tone_mapped_psnr_db(images), -10.0 * std::log10((0.01 + 0.01 + 0.1) / 3.0), 1e-9);
  const ImageError exact[] = {{0.0, std::numeric_limits<double>::infinity()}, {0.1, 20.0}};
  EXPECT_NEAR(tone_mapped_psnr_db(exact), 20.0 + 10.0 * std::log10(2.0), 1e-9);
  const ErrorSpread spread = spread_of(images);
  EXPECT_NEAR(spread.median, 0.2, rounding);
  EXPECT_NEAR(spread.mean, 0.3, rounding);
  EXPECT_EQ(spread.largest, 0.6);
  EXPECT_EQ(spread.worst, 2u);
}

TEST(ImageError, LeavesOutSamplesThatWereNotMeasured) {
  const ImageError error = image_error(filled({2, 100}), filled({4, 5}), {}, filled({0.1f, unmeasured}));
  EXPECT_NEAR(error.relative_rmse, 0.5, rounding);
}

}  // namespace
}  // namespace refield
