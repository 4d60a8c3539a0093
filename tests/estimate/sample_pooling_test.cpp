// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/sample_pooling.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>
#include <vector>

#include "estimate/fit/vector_kernels.h"

namespace refield {
namespace {

constexpr int images = 90;

/// A picture whose samples are sums of a few components, with noise of a given standard deviation relative to
/// the pixel's.
struct NoisyPicture {
  int width = 24, height = 20;
  std::size_t stride = padded_length(images);
  AlignedFloats clean, noisy;  // [pixels][3][stride]

  /// `is_coherent`: adjacent pixels see nearly the same; else each has samples of its own.
  NoisyPicture(double noise, bool is_coherent, bool is_noise_grey = false)
      : clean(static_cast<std::size_t>(width) * height * 3 * stride, 0.0f), noisy(clean) {
    std::mt19937 rng(7);
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> uniform(0.5, 1.5);
    std::vector<std::array<double, 3>> lights(images);
    for (auto& light : lights)
      for (double& each : light) each = uniform(rng);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        const double a = 0.04 * x, b = 0.03 * y;
        for (int j = 0; j < images; ++j) {
          const double grey = normal(rng);
          for (int c = 0; c < 3; ++c) {
            const auto& l = lights[j];
            const double value =
                is_coherent ? l[0] * (1.0 + a) + l[1] * (1.0 - 0.5 * b) + l[2] * a * b : uniform(rng);
            const std::size_t i = index(x, y, c) + j;
            clean[i] = static_cast<float>((1.0 + c) * value);
            noisy[i] = clean[i] * static_cast<float>(1.0 + noise * (is_noise_grey ? grey : normal(rng)));
          }
        }
      }
  }

  std::size_t index(int x, int y, int c) const {
    return ((static_cast<std::size_t>(y) * width + x) * 3 + c) * stride;
  }
  PixelSamples samples(int x, int y) const {
    const float* first = noisy.data();
    return {first + index(x, y, 0), first + index(x, y, 1), first + index(x, y, 2)};
  }
  std::vector<SampleWindow> windows() const {
    std::vector<SampleWindow> result;
    for (int y0 = 0; y0 + 5 <= height; y0 += 5)
      for (int x0 = 0; x0 + 5 <= width; x0 += 5) {
        SampleWindow& window = result.emplace_back();
        for (int y = y0; y < y0 + 5; ++y)
          for (int x = x0; x < x0 + 5; ++x, ++window.pixels)
            for (const float* b : samples(x, y)) window.values.insert(window.values.end(), b, b + images);
      }
    return result;
  }
  /// Gives an image this many times the noise of an image of mean brightness.
  void set_noise(int image, double factor) {
    double level = 0.0;  // of the image, relative to all
    for (int c = 0; c < 3; ++c)
      for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
          const float* pixel = clean.data() + index(x, y, c);
          level += images * pixel[image] / std::accumulate(pixel, pixel + images, 0.0) / (3 * width * height);
        }
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        for (int c = 0; c < 3; ++c) {
          const std::size_t i = index(x, y, c) + image;
          noisy[i] = static_cast<float>(std::lerp(clean[i], noisy[i], factor / level));
        }
  }
  NoiseModel noise() const { return measure_noise(windows(), images, {}); }
  std::vector<PixelSamples> pool(SamplePool& pool, const PixelTile& tile) const {
    return pool.pool(tile, width, height, [this](int x, int y) { return samples(x, y); });
  }
};

TEST(SamplePooling, MeasuresTheNoise) {
  const NoisyPicture picture(0.03, true);
  const NoiseModel noise = picture.noise();
  // 5 %: sampling error of medians of a few windows.
  EXPECT_NEAR(std::sqrt(noise.relative_variance(5.0)), 0.03, 0.05 * 0.03);
  EXPECT_NEAR(noise.samples_per_image, 3.0, 0.2);
  const NoisyPicture grey(0.03, true, true);
  EXPECT_NEAR(std::sqrt(grey.noise().relative_variance(5.0)), 0.03, 0.05 * 0.03);
  EXPECT_NEAR(grey.noise().samples_per_image, 1.0, 0.05);
}

TEST(SamplePooling, WeighsImagesByTheReciprocalOfTheirNoise) {
  NoisyPicture picture(0.02, true);
  const auto factor = [](int image) { return image % 3 == 0 ? 3.0 : 1.0; };
  for (int j = 0; j < images; ++j) picture.set_noise(j, factor(j));
  const NoiseModel noise = picture.noise();
  ASSERT_EQ(noise.image_weights.size(), static_cast<std::size_t>(images));
  std::array<double, 2> mean{};
  for (int j = 0; j < images; ++j) {
    const double scaled = noise.image_weights[j] * factor(j) / noise.image_weights[1];
    EXPECT_NEAR(scaled, 1.0, 0.25) << j;  // from 16 windows
    mean[j % 3 == 0] += scaled / (j % 3 == 0 ? images / 3 : images - images / 3);
  }
  EXPECT_NEAR(mean[1], mean[0], 0.05 * mean[0]);
}

TEST(SamplePooling, KeepsEqualWeightsWhereNoiseIsEqualOrSmall) {
  NoisyPicture equal(0.03, true);
  for (int j = 0; j < images; ++j) equal.set_noise(j, 1.0);
  EXPECT_TRUE(equal.noise().image_weights.empty());
  NoisyPicture little(0.003, true);
  for (int j = 0; j < images; j += 3) little.set_noise(j, 3.0);
  EXPECT_TRUE(little.noise().image_weights.empty());
}

TEST(SamplePooling, LimitsTheWeightOfDarkImages) {
  NoisyPicture picture(0.03, true);
  constexpr int dark = 5;
  for (int y = 0; y < picture.height; ++y)
    for (int x = 0; x < picture.width; ++x)
      for (int c = 0; c < 3; ++c) picture.noisy[picture.index(x, y, c) + dark] = 0.0f;
  const NoiseModel noise = picture.noise();
  ASSERT_FALSE(noise.image_weights.empty());
  std::vector<float> sorted = noise.image_weights;
  std::ranges::sort(sorted);
  EXPECT_NEAR(noise.image_weights[dark], 4.0f * sorted[images / 2], 0.05f);
  EXPECT_EQ(sorted.back(), noise.image_weights[dark]);
}

TEST(SamplePooling, IgnoresImagesThatAreLeftOut) {
  NoisyPicture picture(0.03, true);
  const std::vector<int> left_out = {4};
  const double before = picture.noise().relative_variance(5.0);
  const double without = measure_noise(picture.windows(), images, left_out).relative_variance(5.0);
  std::mt19937 rng(3);
  std::uniform_real_distribution<float> uniform(0.0f, 9.0f);
  for (int y = 0; y < picture.height; ++y)
    for (int x = 0; x < picture.width; ++x)
      for (int c = 0; c < 3; ++c) picture.noisy[picture.index(x, y, c) + 4] = uniform(rng);
  EXPECT_NE(picture.noise().relative_variance(5.0), before);
  EXPECT_EQ(measure_noise(picture.windows(), images, left_out).relative_variance(5.0), without);
}

TEST(SamplePooling, ReducesNoiseOfPixelsThatSeeAlike) {
  const NoisyPicture picture(0.03, true);
  SamplePool pool(picture.noise(), images);
  const auto pooled = picture.pool(pool, {0, 0, picture.width, picture.height});
  double before = 0.0, after = 0.0;
  for (int y = 0; y < picture.height; ++y)
    for (int x = 0; x < picture.width; ++x)
      for (int c = 0; c < 3; ++c)
        for (int j = 0; j < images; ++j) {
          const double truth = picture.clean[picture.index(x, y, c) + j];
          before += std::pow(picture.samples(x, y)[c][j] - truth, 2);
          after += std::pow(pooled[y * picture.width + x][c][j] - truth, 2);
        }
  // Three components of 25 hold an eighth of the noise; overlapping windows reduce it further.
  EXPECT_LT(after, before / 8.0);
}

TEST(SamplePooling, KeepsSamplesOfPixelsThatDiffer) {
  const NoisyPicture alike(0.03, true), differing(0.03, false);
  SamplePool pool(alike.noise(), images);
  const auto pooled = differing.pool(pool, {0, 0, differing.width, differing.height});
  for (int y = 0; y < differing.height; ++y)
    for (int x = 0; x < differing.width; ++x)
      EXPECT_EQ(pooled[y * differing.width + x], differing.samples(x, y));
}

TEST(SamplePooling, KeepsSamplesWithLittleNoise) {
  const NoisyPicture picture(0.005, true);
  SamplePool pool(picture.noise(), images);
  EXPECT_EQ(picture.pool(pool, {4, 4, 5, 5})[0], picture.samples(4, 4));
  SamplePool unknown({}, images);
  EXPECT_EQ(picture.pool(unknown, {4, 4, 5, 5})[0], picture.samples(4, 4));
}

TEST(SamplePooling, DoesNotDependOnTiles) {
  const NoisyPicture picture(0.03, true);
  SamplePool pool(picture.noise(), images), parts(picture.noise(), images);
  const auto whole = picture.pool(pool, {0, 0, picture.width, picture.height});
  for (int y = 0; y < picture.height; y += 4)
    for (int x = 0; x < picture.width; x += 8) {
      const auto part = picture.pool(parts, {x, y, x + 8, y + 4});
      for (int p = 0; p < 32; ++p)
        for (int c = 0; c < 3; ++c)
          for (int j = 0; j < images; ++j)
            ASSERT_EQ(part[p][c][j], whole[(y + p / 8) * picture.width + x + p % 8][c][j]);
    }
}

TEST(SamplePooling, LeavesOutPixelsWithMissingSamples) {
  NoisyPicture picture(0.03, true);
  picture.noisy[picture.index(6, 6, 1) + 3] = std::numeric_limits<float>::quiet_NaN();
  SamplePool pool(NoisyPicture(0.03, true).noise(), images);
  const auto pooled = pool.pool({4, 4, 8, 8}, picture.width, picture.height, [&](int x, int y) {
    return x == 5 && y == 5 ? PixelSamples{} : picture.samples(x, y);
  });
  EXPECT_EQ(pooled[1 * 4 + 1], PixelSamples{});
  EXPECT_EQ(pooled[2 * 4 + 2], picture.samples(6, 6));
  for (const int p : {0, 6, 9, 15}) {
    EXPECT_NE(pooled[p], picture.samples(4 + p % 4, 4 + p / 4));
    for (int j = 0; j < images; ++j) EXPECT_TRUE(std::isfinite(pooled[p][1][j]));
  }
}

}  // namespace
}  // namespace refield
