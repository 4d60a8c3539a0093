// SPDX-License-Identifier: Apache-2.0
#include "simulate/rig/device_models.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <set>

#include "core/base/errors.h"
#include "tests/simulate/sensor_statistics.h"

namespace refield {
namespace {

Image flat(float r, float g, float b, int width = 200, int height = 100) {
  Image image(width, height, 3);
  for (std::size_t i = 0; i < image.values.size(); ++i) image.values[i] = i % 3 == 0 ? r : i % 3 == 1 ? g : b;
  return image;
}

struct Moments {
  double mean, variance;
};
Moments moments(const std::vector<std::uint16_t>& samples) {
  double mean = 0.0, square = 0.0;
  for (double v : samples) mean += v, square += v * v;
  mean /= static_cast<double>(samples.size());
  return {mean, square / static_cast<double>(samples.size()) - mean * mean};
}

TEST(Sensor, MomentsFollowTheModel) {
  SensorModel sensor;
  sensor.electrons_per_dn = 1.5;
  const Seconds exposure(0.05);
  for (const auto& [radiance, gain] :
       {std::pair{0.0, 1.0}, {0.002, 2.0}, {0.05, 1.0}, {0.3, 1.0}, {0.05, 4.0}}) {
    const auto r = static_cast<float>(radiance);
    const auto samples = sensor.expose(flat(r, r, r), exposure, gain, 99);
    const Moments found = moments(samples);
    const double mean = test::mean_dn(sensor, radiance, exposure, gain);
    const double variance =
        test::variance_dn(sensor, radiance, exposure, gain) + 1.0 / 12.0;  // rounding to whole DN
    const double n = static_cast<double>(samples.size());
    EXPECT_NEAR(found.mean, mean, 5.0 * std::sqrt(variance / n)) << radiance;  // five standard errors
    EXPECT_NEAR(found.variance, variance, 6.0 * variance * std::sqrt(2.0 / n) + 0.01) << radiance;
  }
}

TEST(Sensor, ClipsAtFullScaleAndFullWell) {
  SensorModel sensor;
  sensor.full_well_electrons = 1e9;
  for (std::uint16_t v : sensor.expose(flat(1, 1, 1, 20, 20), Seconds(1.0), 1.0, 1)) EXPECT_EQ(v, 4095);
  sensor.full_well_electrons = 8000.0;
  const double full_well = sensor.black_level_dn + 8000.0 / sensor.electrons_per_dn;
  for (std::uint16_t v : sensor.expose(flat(1, 1, 1, 20, 20), Seconds(1.0), 1.0, 1))
    EXPECT_NEAR(v, full_well, 0.5);
}

TEST(Sensor, BitsSetTheNumberOfLevels) {
  for (int bits : {8, 10, 12}) {
    SensorModel sensor;
    sensor.bits = bits;
    sensor.black_level_dn = 4.0;
    sensor.electrons_per_dn = 10000.0 / sensor.full_scale();
    sensor.full_well_electrons = 1e9;
    Image ramp(4096, 1, 3);
    for (int x = 0; x < 4096; ++x)
      for (int c = 0; c < 3; ++c) ramp.at(x, 0, c) = static_cast<float>(x) / 4095.0f;
    const auto samples = sensor.expose(ramp, Seconds(0.06), 1.0, 5);
    const std::set<std::uint16_t> levels(samples.begin(), samples.end());
    EXPECT_EQ(*levels.rbegin(), (1 << bits) - 1);
    EXPECT_GT(levels.size(), static_cast<std::size_t>(0.7 * (1 << bits)));
  }
}

TEST(Sensor, ResponseCurveBendsTheLinearValue) {
  SensorModel sensor;
  sensor.black_level_dn = 0.0;
  sensor.read_noise_electrons = 0.0;
  sensor.response_gamma = 2.2;
  sensor.sensitivity = 1e7;  // so bright that shot noise is small
  sensor.electrons_per_dn = 2000.0;
  sensor.full_well_electrons = 1e9;
  const double linear = test::mean_dn(sensor, 0.2, Seconds(1.0), 1.0);
  const Moments found = moments(sensor.expose(flat(0.2f, 0.2f, 0.2f), Seconds(1.0), 1.0, 3));
  EXPECT_NEAR(found.mean, 4095.0 * std::pow(linear / 4095.0, 1.0 / 2.2), 1.0);
}

TEST(Sensor, BayerAndGreySamplesSeeTheirChannels) {
  SensorModel sensor;
  sensor.read_noise_electrons = 0.0;
  sensor.layout = PixelLayout::bayer_rggb;
  const Seconds exposure(0.02);
  const Image image = flat(0.9f, 0.5f, 0.1f, 64, 64);
  const auto bayer = sensor.expose(image, exposure, 1.0, 11);
  ASSERT_EQ(bayer.size(), 64u * 64u);
  const float expected[2][2] = {{0.9f, 0.5f}, {0.5f, 0.1f}};  // [row parity][column parity]
  for (int py = 0; py < 2; ++py)
    for (int px = 0; px < 2; ++px) {
      std::vector<std::uint16_t> samples;
      for (int y = py; y < 64; y += 2)
        for (int x = px; x < 64; x += 2) samples.push_back(bayer[y * 64 + x]);
      const double mean = test::mean_dn(sensor, expected[py][px], exposure, 1.0);
      EXPECT_NEAR(moments(samples).mean, mean,
                  5.0 * std::sqrt(test::variance_dn(sensor, expected[py][px], exposure, 1.0) /
                                  static_cast<double>(samples.size())));
    }
  sensor.layout = PixelLayout::grey;
  EXPECT_NEAR(moments(sensor.expose(image, exposure, 1.0, 11)).mean,
              test::mean_dn(sensor, 0.5, exposure, 1.0), 2.0);
}

TEST(Sensor, NoiseIsAFunctionOfItsKey) {
  const SensorModel sensor;
  const Image image = flat(0.1f, 0.2f, 0.3f);
  const auto once = sensor.expose(image, Seconds(0.01), 1.0, 42);
  EXPECT_EQ(once, sensor.expose(image, Seconds(0.01), 1.0, 42));
  EXPECT_NE(once, sensor.expose(image, Seconds(0.01), 1.0, 43));
}

}  // namespace
}  // namespace refield
