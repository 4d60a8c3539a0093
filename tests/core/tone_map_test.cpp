// SPDX-License-Identifier: Apache-2.0
#include "core/image/tone_map.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>

#include "core/base/errors.h"
#include "tests/support/random_data.h"

namespace refield {
namespace {

constexpr float infinity = std::numeric_limits<float>::infinity();
constexpr float not_a_number = std::numeric_limits<float>::quiet_NaN();

/// Radiances over all orders of magnitude, beside the special ones.
std::vector<float> radiances() {
  std::vector<float> values = {0.0f, -0.0f, -3.0f, 1.0f, infinity, -infinity, not_a_number, 1e-42f, 3e38f};
  Rng rng{7};
  for (int i = 0; i < 200000; ++i) values.push_back(static_cast<float>(std::exp2(rng.uniform(-20.0, 12.0))));
  return values;
}

TEST(ToneMap, TableIsExact) {
  for (const ToneOperator curve : tone_operators)
    for (const double exposure : {0.01, 1.0, 37.5}) {
      const ToneMapping mapping{exposure, curve};
      const LevelTable table(mapping);
      for (const float value : radiances())
        ASSERT_EQ(table(value), tone_mapped(value, mapping)) << name_of(curve) << " of " << value;
    }
}

TEST(ToneMap, CurvesHoldWhatTheirSourcesSay) {
  const auto shown = [](double value, ToneOperator curve) {
    return linear_from_srgb(tone_mapped(static_cast<float>(value), {1.0, curve}) / 255.0f);
  };
  constexpr double one_level = 0.009;  // of 255, at the steepest: srgb⁻¹ has slope 2.3 at white
  EXPECT_NEAR(shown(0.5, ToneOperator::clip), 0.5, one_level);
  EXPECT_EQ(tone_mapped(1.0f, {1.0, ToneOperator::clip}), 255);
  EXPECT_NEAR(shown(1.0, ToneOperator::reinhard), (1.0 + 1.0 / 16.0) / 2.0, one_level);
  EXPECT_EQ(tone_mapped(4.0f, {1.0, ToneOperator::reinhard}), 255);
  EXPECT_LT(tone_mapped(3.9f, {1.0, ToneOperator::reinhard}), 255);
  EXPECT_NEAR(shown(0.18, ToneOperator::filmic),
              (0.18 * (2.51 * 0.18 + 0.03)) / (0.18 * (2.43 * 0.18 + 0.59) + 0.14), one_level);
  for (const ToneOperator curve : tone_operators) {
    EXPECT_EQ(tone_mapped(0.0f, {1.0, curve}), 0);
    EXPECT_EQ(tone_mapped(infinity, {1.0, curve}), 255);
    EXPECT_EQ(tone_mapped(not_a_number, {1.0, curve}), 0);
    EXPECT_EQ(tone_mapped(0.5f, {0.25, curve}), tone_mapped(0.125f, {1.0, curve}));
  }
}

TEST(ToneMap, ImagesAreMappedValueByValue) {
  Rng rng{3};
  const Image image = test::random_image(rng, 37, 19, 3, -0.1, 3.0);
  const ToneMapping mapping{0.7, ToneOperator::filmic};
  const auto levels = tone_mapped(image, mapping);
  std::vector<std::uint8_t> rgba(image.pixel_count() * 4);
  tone_map_rgba(image, LevelTable(mapping), rgba);
  for (std::size_t p = 0; p < image.pixel_count(); ++p) {
    for (std::size_t c = 0; c < 3; ++c) {
      ASSERT_EQ(levels[3 * p + c], tone_mapped(image.values[3 * p + c], mapping));
      ASSERT_EQ(rgba[4 * p + c], levels[3 * p + c]);
    }
    ASSERT_EQ(rgba[4 * p + 3], 255);
  }
  rgba.pop_back();
  EXPECT_THROW(tone_map_rgba(image, LevelTable(mapping), rgba), InputError);
}

// Values beside every step, on both sides, and those that are no light; a curve with several levels per cell.
TEST(ToneMap, PixelsInVectorsAreAsValueByValue) {
  const auto threshold = [](float value) {
    return static_cast<std::uint8_t>(value < 1.0f ? 0 : value < 1.001f ? 3 : value < 1.002f ? 90 : 255);
  };
  const ToneMapping mapping{3.0, ToneOperator::filmic};
  for (const LevelTable& table : {LevelTable(mapping), LevelTable(threshold)}) {
    std::vector<float> values{0.0f, -0.0f, -1.0f, -infinity, infinity, not_a_number, -not_a_number, 1e-38f};
    for (float value = 1e-6f; value < 40.0f; value *= 1.0005f) {
      values.push_back(value);
      if (table(value) != table(std::nextafter(value, 0.0f))) values.push_back(std::nextafter(value, 0.0f));
    }
    values.resize(values.size() / 3 * 3);
    Image image(static_cast<int>(values.size() / 3), 1, 3);
    image.values = values;
    std::vector<std::uint8_t> rgba(image.pixel_count() * 4);
    tone_map_rgba(image, table, rgba);
    for (std::size_t i = 0; i < values.size(); ++i)
      ASSERT_EQ(rgba[i / 3 * 4 + i % 3], table(values[i])) << values[i];
  }
}

TEST(ToneMap, WhiteIsThe99thPercentile) {
  Image image(100, 100, 3, 0.5f);
  for (int x = 0; x < 50; ++x) image.at(x, 0, 1) = 1000.0f;  // half a percent: area lights in the picture
  EXPECT_DOUBLE_EQ(exposure_to_white(image), 2.0);
  EXPECT_DOUBLE_EQ(exposure_to_white(Image(4, 4, 3)), 1.0);
}

TEST(AutoExposure, ABlackBackgroundDoesNotCount) {
  Image image(100, 100, 3);  // nine tenths show nothing
  for (int y = 0; y < 10; ++y)
    for (int x = 0; x < 100; ++x)
      for (int c = 0; c < 3; ++c) image.at(x, y, c) = static_cast<float>(10 * x + y + 1) / 1000.0f;
  EXPECT_NEAR(exposure_to_white(image), 1.0 / 0.991, 1e-6);
  EXPECT_LE(clipped_share(image, exposure_to_white(image)), 0.015) << "with levels that round up to white";
  Mask mask(10000, 0);
  mask[0] = mask[5050] = 1;
  EXPECT_DOUBLE_EQ(exposure_to_white(image, mask), 1.0 / image.at(0, 0, 0));
}

TEST(AutoExposure, HasThreeDigitsAndClipsFewerThanOnePixelInAHundred) {
  Rng rng(3);
  for (const double scale : {1e-9, 0.037, 1.0, 777.0, 3e20}) {
    Image image(60, 50, 3);
    for (float& value : image.values) value = static_cast<float>(scale * std::exp(4.0 * rng.uniform()));
    ExposureMeter meter;
    meter.add(image);
    const double exposure = meter.exposure();
    EXPECT_LE(exposure, exposure_to_white(image));
    EXPECT_GT(exposure, 0.97 * exposure_to_white(image));
    char text[32];
    std::snprintf(text, sizeof text, "%.3g", exposure);
    EXPECT_EQ(std::strtod(text, nullptr), exposure) << text;
    const auto levels = tone_mapped(image, {exposure});
    int white = 0;
    for (std::size_t p = 0; p < image.pixel_count(); ++p)
      white += *std::max_element(levels.begin() + 3 * p, levels.begin() + 3 * p + 3) == 255;
    EXPECT_LE(white, 0.01 * image.pixel_count());
    EXPECT_DOUBLE_EQ(clipped_share(image, exposure), white / 3000.0);
  }
}

TEST(AutoExposure, SeveralPicturesShareOne) {
  ExposureMeter meter;
  meter.add(Image(10, 10, 3, 0.01f));
  meter.add(Image(10, 10, 3, 2.0f));
  EXPECT_DOUBLE_EQ(meter.exposure_to_white(), 0.5);
  EXPECT_DOUBLE_EQ(clipped_share(Image(2, 2, 3, 2.0f), 1.0), 1.0);
  EXPECT_DOUBLE_EQ(clipped_share(Image(2, 2, 3), 1.0), 0.0);
}

TEST(FalseColour, LevelsAreEvenInValueAndInStops) {
  const LevelTable linear = linear_levels(0.2);
  EXPECT_EQ(linear(0.0f), 0);
  EXPECT_EQ(linear(0.1f), 128);
  EXPECT_EQ(linear(0.2f), 255);
  EXPECT_EQ(linear(5.0f), 255);
  const LevelTable stops = stop_levels(-8.0, 2.0);
  EXPECT_EQ(stops(0.0f), 0);
  EXPECT_EQ(stops(std::exp2(-8.5f)), 0);
  EXPECT_EQ(stops(std::exp2(-3.0f)), 128);
  EXPECT_EQ(stops(4.0f), 255);
  EXPECT_THROW(linear_levels(0.0), InputError);
  EXPECT_THROW(stop_levels(2.0, 2.0), InputError);
}

TEST(FalseColour, ShowsLuminanceAndMarksWhatIsUnknown) {
  Image image(3, 1, 3);
  for (int c = 0; c < 3; ++c) image.at(1, 0, c) = 1.0f;
  image.at(2, 0, 1) = not_a_number;
  std::vector<std::uint8_t> rgba(12);
  false_colour_rgba(image, linear_levels(1.0), rgba);
  const auto expected = [](double fraction, int c) {
    return static_cast<int>(std::lround(255.0f * false_colour(fraction)[c]));
  };
  for (int c = 0; c < 3; ++c) {
    EXPECT_EQ(rgba[c], expected(0.0, c));
    EXPECT_EQ(rgba[4 + c], expected(1.0, c));
    EXPECT_EQ(rgba[8 + c], 128);
  }
}

}  // namespace
}  // namespace refield
