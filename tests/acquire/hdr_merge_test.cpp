// SPDX-License-Identifier: Apache-2.0
#include "acquire/hdr/hdr_merge.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/base/errors.h"
#include "core/base/rng.h"

namespace refield {
namespace {

CameraCalibration twelve_bits() {
  CameraCalibration camera;
  camera.bits = 12;
  camera.linear_from_dn = linear_response(12);
  camera.black_level_dn = 64.0;
  camera.saturation_dn = 4095.0;
  camera.electrons_per_dn = 2.5;
  camera.read_noise_electrons = 4.0;
  camera.electrons_per_radiance_second = 200'000.0;
  return camera;
}

const std::vector<double> plan = {0.0025, 0.01, 0.04, 0.16};

/// Frames of one radiance per sample. With a generator, the camera's noise is added.
std::vector<RawFrame> photograph(const std::vector<double>& radiance, int width, int height,
                                 PixelLayout layout, const CameraCalibration& camera, Rng* noise = nullptr) {
  std::vector<RawFrame> frames;
  for (double seconds : plan) {
    RawFrame frame{width, height, layout, {}, {}, Seconds(seconds), 1.0, frames.size()};
    for (double r : radiance) {
      double electrons = r * seconds * camera.electrons_per_radiance_second;
      if (noise) electrons = noise->poisson(electrons) + camera.read_noise_electrons * noise->normal();
      const double dn = camera.black_level_dn + electrons / camera.electrons_per_dn;
      frame.samples.push_back(
          static_cast<std::uint16_t>(std::clamp(std::round(dn), 0.0, camera.saturation_dn)));
    }
    frames.push_back(std::move(frame));
  }
  return frames;
}

TEST(HdrMerge, RecoversRadianceToQuantisation) {
  const auto camera = twelve_bits();
  std::vector<double> radiance;
  for (int i = 0; i < 48; ++i) radiance.push_back(1e-3 * std::pow(10.0, 3.0 * i / 47.0));
  const auto merged = merge_exposures(photograph(radiance, 4, 4, PixelLayout::rgb, camera), camera);
  for (std::size_t i = 0; i < radiance.size(); ++i) {
    // Every exposure may be off by half a DN. With weights ~ 1 / exposure these add up to n / 2 DN over Σ
    // exposure.
    double usable = 0.0;
    double time = 0.0;
    for (double t : plan)
      if (64.0 + radiance[i] * t * 80'000.0 < 4095.0 * 0.99) {
        usable += 1.0;
        time += t;
      }
    ASSERT_GT(usable, 0.0);
    EXPECT_NEAR(merged.radiance.values[i], radiance[i], 0.5 * usable / (time * 80'000.0) + 1e-6 * radiance[i])
        << i;
    EXPECT_GT(merged.sigma.values[i], 0.0f);
  }
}

TEST(HdrMerge, IsUnbiasedAndKnowsItsNoise) {
  const auto camera = twelve_bits();
  constexpr int width = 100;
  constexpr int height = 40;
  constexpr int samples = width * height * 3;
  Rng noise(7);
  for (double truth : {0.0, 2e-4, 0.003, 0.05, 0.6}) {
    const auto merged = merge_exposures(
        photograph(std::vector<double>(samples, truth), width, height, PixelLayout::rgb, camera, &noise),
        camera);
    double mean = 0.0;
    double predicted_variance = 0.0;
    for (int i = 0; i < samples; ++i) {
      mean += merged.radiance.values[i] / samples;
      predicted_variance += std::pow(merged.sigma.values[i], 2) / samples;
    }
    double variance = 0.0;
    for (float r : merged.radiance.values) variance += (r - mean) * (r - mean) / (samples - 1);
    // The mean of n samples scatters by sigma / sqrt(n): five times that is beyond chance.
    EXPECT_NEAR(mean, truth, 5.0 * std::sqrt(variance / samples)) << truth;
    // The empirical sigma itself scatters by 1 / sqrt(2 n) = 0.65 %; five times that. Without light, shot
    // noise is predicted from noise alone, and never below zero: sigma is then a little large.
    const double tolerance = truth > 0.0 ? 0.033 : 0.06;
    EXPECT_NEAR(std::sqrt(predicted_variance / variance), 1.0, tolerance) << truth;
  }
}

TEST(HdrMerge, WeightsFromObservedValuesWouldBeBiased) {
  // The reason for predicted weights: the naive way is off by about one electron an exposure.
  const auto camera = twelve_bits();
  constexpr int samples = 30'000;
  const double truth = 5e-4;  // 16 electrons in the longest exposure
  Rng noise(11);
  const auto frames =
      photograph(std::vector<double>(samples, truth), 100, 100, PixelLayout::rgb, camera, &noise);
  double naive = 0.0;
  for (int i = 0; i < samples; ++i) {
    double top = 0.0;
    double bottom = 0.0;
    for (const RawFrame& frame : frames) {
      const double t = frame.exposure.count() * camera.electrons_per_radiance_second;
      const double e = (frame.samples[i] - camera.black_level_dn) * camera.electrons_per_dn;
      const double weight = 1.0 / (std::max(e, 0.0) + 16.0);
      top += weight * t * e;
      bottom += weight * t * t;
    }
    naive += top / bottom / samples;
  }
  double mean = 0.0;
  for (float r : merge_exposures(frames, camera).radiance.values) mean += r / samples;
  EXPECT_LT(naive, truth * 0.98);
  EXPECT_NEAR(mean, truth, truth * 0.01);  // five times the scatter of the mean
}

TEST(HdrMerge, LeavesClippedSamplesOut) {
  const auto camera = twelve_bits();
  // The second pixel clips in the two longest exposures, the third in all.
  const std::vector<double> radiance = {0.01, 0.01, 0.01, 2.0, 2.0, 2.0, 500.0, 500.0, 500.0, 0.1, 0.1, 0.1};
  const auto frames = photograph(radiance, 2, 2, PixelLayout::rgb, camera);
  MergeStatistics statistics;
  const auto merged = merge_exposures(frames, camera, {}, &statistics);
  EXPECT_NEAR(merged.radiance.values[3], 2.0, 2.0 * 1e-3);
  EXPECT_TRUE(std::isfinite(merged.sigma.values[3]));
  EXPECT_TRUE(std::isinf(merged.sigma.values[6]));
  const double clipping_level = (4095.0 - 64.0) / (80'000.0 * plan[0]);
  EXPECT_NEAR(merged.radiance.values[6], clipping_level, 1e-3 * clipping_level);
  EXPECT_DOUBLE_EQ(statistics.clipped_fraction, 0.25);
  EXPECT_DOUBLE_EQ(statistics.useful_fraction[3], 0.5);  // clipped for the two bright pixels
}

TEST(HdrMerge, StaysClearOfSaturationThatWasNotMeasured) {
  auto camera = twelve_bits();
  RawFrame frame{1, 1, PixelLayout::grey, {4060}, {}, Seconds(0.01), 1.0, 0};
  EXPECT_TRUE(
      std::isinf(merge_exposures(std::span(&frame, 1), camera, with_unmeasured_saturation).sigma.values[0]));
  EXPECT_TRUE(std::isfinite(merge_exposures(std::span(&frame, 1), camera).sigma.values[0]));
}

TEST(HdrMerge, AllExposuresClippedGiveNoFalseNumbers) {
  const auto camera = twelve_bits();
  const auto frames = photograph({1e6}, 1, 1, PixelLayout::grey, camera);
  const auto merged = merge_exposures(frames, camera);
  for (int c = 0; c < 3; ++c) {
    EXPECT_TRUE(std::isfinite(merged.radiance.at(0, 0, c)));
    EXPECT_EQ(merged.sigma.at(0, 0, c), INFINITY);
  }
}

TEST(HdrMerge, LinearisesTheResponse) {
  auto camera = twelve_bits();
  camera.linear_from_dn = gamma_response(12, 2.2);
  std::vector<RawFrame> frames;
  for (double seconds : plan) {
    RawFrame frame{1, 1, PixelLayout::grey, {}, {}, Seconds(seconds), 1.0, 0};
    const double linear = std::min(64.0 + 0.2 * seconds * 80'000.0, 4095.0);
    frame.samples.push_back(
        static_cast<std::uint16_t>(std::lround(4095.0 * std::pow(linear / 4095.0, 1.0 / 2.2))));
    frames.push_back(frame);
  }
  EXPECT_NEAR(merge_exposures(frames, camera).radiance.values[0], 0.2, 0.2 * 1e-3);
}

TEST(HdrMerge, GainChangesDigitalNumbersOnly) {
  const auto camera = twelve_bits();
  RawFrame plain{1, 1, PixelLayout::grey, {64 + 800}, {}, Seconds(0.01), 1.0, 0};
  RawFrame amplified{1, 1, PixelLayout::grey, {64 + 3200}, {}, Seconds(0.01), 4.0, 0};
  const std::vector<RawFrame> both = {plain, amplified};
  EXPECT_NEAR(merge_exposures(both, camera).radiance.values[0], 1.0, 1e-6);
  EXPECT_NEAR(merge_exposures(std::span(&amplified, 1), camera).radiance.values[0], 1.0, 1e-6);
}

TEST(HdrMerge, RepeatsLowerTheNoise) {
  const auto camera = twelve_bits();
  RawFrame frame{1, 1, PixelLayout::grey, {1000}, {}, Seconds(0.01), 1.0, 0};
  const std::vector<RawFrame> four(4, frame);
  const float one = merge_exposures(std::span(&frame, 1), camera).sigma.values[0];
  EXPECT_NEAR(merge_exposures(four, camera).sigma.values[0], one / 2.0f, 1e-5 * one);
}

TEST(HdrMerge, BayerOfAFlatFieldIsFlat) {
  const auto camera = twelve_bits();
  constexpr int width = 7;  // odd: borders of both kinds
  constexpr int height = 5;
  const double colour[3] = {0.05, 0.02, 0.08};
  std::vector<double> samples;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) samples.push_back(colour[(x & 1) + (y & 1)]);
  const auto merged =
      merge_exposures(photograph(samples, width, height, PixelLayout::bayer_rggb, camera), camera);
  ASSERT_EQ(merged.radiance.channels, 3);
  constexpr double quantisation = 0.5 / (0.04 * 80'000.0);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int c = 0; c < 3; ++c) EXPECT_NEAR(merged.radiance.at(x, y, c), colour[c], quantisation);
}

TEST(Demosaic, InterpolatesPlanesExactlyInside) {
  Image plane(8, 8, 1);
  Image sigma(8, 8, 1, 0.1f);
  for (int y = 0; y < 8; ++y)
    for (int x = 0; x < 8; ++x) plane.at(x, y, 0) = static_cast<float>(2 * x + 3 * y);
  const Photograph rgb = demosaic(plane, sigma, PixelLayout::bayer_rggb);
  for (int y = 1; y < 7; ++y)
    for (int x = 1; x < 7; ++x)
      for (int c = 0; c < 3; ++c) EXPECT_NEAR(rgb.radiance.at(x, y, c), 2 * x + 3 * y, 1e-4);
  EXPECT_FLOAT_EQ(rgb.sigma.at(2, 2, 0), 0.1f);                    // measured
  EXPECT_NEAR(rgb.sigma.at(2, 2, 1), 0.05f, 1e-6);                 // mean of four
  EXPECT_NEAR(rgb.sigma.at(3, 2, 0), 0.1 / std::sqrt(2.0), 1e-6);  // mean of two
}

TEST(Demosaic, EveryOrderOfColoursGivesTheColours) {
  const std::array<float, 3> colour = {0.25f, 0.5f, 0.75f};
  for (PixelLayout layout :
       {PixelLayout::bayer_rggb, PixelLayout::bayer_grbg, PixelLayout::bayer_gbrg, PixelLayout::bayer_bggr}) {
    // The layout's name spells the first four sites.
    const std::string letters = std::string(layout_name(layout)).substr(6);
    Image plane(6, 4, 1);
    for (int y = 0; y < 4; ++y)
      for (int x = 0; x < 6; ++x)
        plane.at(x, y, 0) = colour[std::string("rgb").find(letters[2 * (y % 2) + x % 2])];
    const Photograph rgb = demosaic(plane, Image(6, 4, 1, 0.1f), layout);
    for (int y = 0; y < 4; ++y)
      for (int x = 0; x < 6; ++x)
        for (int c = 0; c < 3; ++c) EXPECT_FLOAT_EQ(rgb.radiance.at(x, y, c), colour[c]) << letters;
  }
}

TEST(Demosaic, ClippedSamplesSpreadToWhatRestsOnThem) {
  Image plane(6, 6, 1, 1.0f);
  Image sigma(6, 6, 1, 0.1f);
  sigma.at(2, 2, 0) = INFINITY;  // a red site
  const Photograph rgb = demosaic(plane, sigma, PixelLayout::bayer_rggb);
  EXPECT_TRUE(std::isinf(rgb.sigma.at(2, 2, 0)));
  EXPECT_TRUE(std::isinf(rgb.sigma.at(3, 3, 0)));
  EXPECT_TRUE(std::isfinite(rgb.sigma.at(4, 4, 0)));
  EXPECT_TRUE(std::isfinite(rgb.sigma.at(2, 2, 1)));
}

TEST(HdrMerge, MergesLinearImages) {
  std::vector<Image> images;
  std::vector<Seconds> times = {Seconds(0.1), Seconds(0.4), Seconds(1.6)};
  const std::vector<float> radiance = {0.1f, 0.5f, 2.0f};
  for (Seconds t : times) {
    Image image(1, 1, 3);
    for (int c = 0; c < 3; ++c)
      image.values[c] = std::min(1.0f, 0.02f + radiance[c] * static_cast<float>(t.count()));
    images.push_back(image);
  }
  LinearSensor sensor;
  sensor.black = 0.02;
  sensor.saturation = 1.0;
  const auto merged = merge_linear_exposures(images, times, sensor);
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(merged.radiance.values[c], radiance[c], 1e-5 * radiance[c]) << c;
}

TEST(HdrMerge, SubtractsAmbientLightAndAddsVariances) {
  Photograph photograph{Image(1, 1, 3, 0.5f), Image(1, 1, 3, 0.03f)};
  Photograph ambient{Image(1, 1, 3, 0.6f), Image(1, 1, 3, 0.04f)};
  ambient.sigma.values[2] = INFINITY;
  subtract_ambient(photograph, ambient);
  EXPECT_NEAR(photograph.radiance.values[0], -0.1f, 1e-6);  // kept negative
  EXPECT_NEAR(photograph.sigma.values[0], 0.05f, 1e-6);
  EXPECT_TRUE(std::isinf(photograph.sigma.values[2]));
}

TEST(HdrMerge, RefusesWhatDoesNotFitTogether) {
  const auto camera = twelve_bits();
  RawFrame small{1, 1, PixelLayout::grey, {100}, {}, Seconds(0.01), 1.0, 0};
  RawFrame large{2, 1, PixelLayout::grey, {100, 100}, {}, Seconds(0.01), 1.0, 0};
  const std::vector<RawFrame> mixed = {small, large};
  EXPECT_THROW(merge_exposures(mixed, camera), InputError);
  EXPECT_THROW(merge_exposures({}, camera), InputError);
  RawFrame beyond = small;
  beyond.samples[0] = 4096;
  EXPECT_THROW(merge_exposures(std::span(&beyond, 1), camera), InputError);
  RawFrame timeless = small;
  timeless.exposure = Seconds(0);
  EXPECT_THROW(merge_exposures(std::span(&timeless, 1), camera), InputError);
}

}  // namespace
}  // namespace refield
