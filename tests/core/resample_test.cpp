// SPDX-License-Identifier: Apache-2.0
#include "core/image/image.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "core/base/errors.h"
#include "tests/support/random_data.h"

namespace refield {
namespace {

double mean(const Image& image) {
  return std::accumulate(image.values.begin(), image.values.end(), 0.0) /
         static_cast<double>(image.values.size());
}

/// The mean over a texel by many samples: slow, and by no fractions at all.
float sampled(const Image& image, double left, double top, double width, double height, int c) {
  constexpr int samples = 210;  // divides evenly by the sizes below
  double sum = 0.0;
  for (int j = 0; j < samples; ++j)
    for (int i = 0; i < samples; ++i)
      sum += image.at(static_cast<int>(left + (i + 0.5) / samples * width),
                      static_cast<int>(top + (j + 0.5) / samples * height), c);
  return static_cast<float>(sum / (samples * samples));
}

TEST(ResampleArea, IsTheMeanOverEachTexel) {
  Rng random(2);
  const Image image = test::random_image(random, 12, 10, 3);
  for (const auto& [width, height] : {std::pair{7, 5}, {5, 7}, {12, 10}, {30, 14}, {1, 1}}) {
    const Image result = resample_area(image, width, height);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        const double w = 12.0 / width, h = 10.0 / height;
        constexpr float grid = 0.01f;  // of the samples
        EXPECT_NEAR(result.at(x, y, 1), sampled(image, x * w, y * h, w, h, 1), grid);
      }
    EXPECT_NEAR(mean(result), mean(image), 1e-6);
  }
  EXPECT_EQ(resample_area(image, 12, 10).values, image.values);
}

TEST(ResampleArea, WholeMultiplesRepeatTexels) {
  Rng random(3);
  const Image image = test::random_image(random, 5, 4, 3);
  const Image twice = resample_area(image, 10, 12);
  for (int y = 0; y < 12; ++y)
    for (int x = 0; x < 10; ++x) EXPECT_FLOAT_EQ(twice.at(x, y, 2), image.at(x / 2, y / 3, 2));
}

TEST(ResampleArea, CroppingKeepsShapes) {
  Image image(16, 9, 3);
  for (int y = 0; y < 9; ++y)
    for (int x = 0; x < 16; ++x) image.at(x, y, 0) = static_cast<float>(x);
  const Image result = resample_area_cropped(image, 4, 3);  // columns 2 to 14 of it
  for (int x = 0; x < 4; ++x) EXPECT_NEAR(result.at(x, 1, 0), 2.0 + 3.0 * x + 1.0, 1e-5);
  EXPECT_THROW(resample_area_cropped(image, 0, 3), InputError);
  EXPECT_THROW(resample_area(Image(), 4, 3), InputError);
}

}  // namespace
}  // namespace refield
