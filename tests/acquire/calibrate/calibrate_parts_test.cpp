// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "acquire/calibrate/calibrate.h"
#include "acquire/calibrate/calibration.h"
#include "core/base/errors.h"
#include "core/base/rng.h"

namespace refield {
namespace {

TEST(MonotoneCurve, PassesThroughItsPointsAndNeverOvershoots) {
  const MonotoneCurve curve({0, 1, 2, 3, 5}, {0, 0, 1, 1, 4});
  EXPECT_DOUBLE_EQ(curve(2), 1.0);
  EXPECT_DOUBLE_EQ(curve(0.5), 0.0);
  double last = -1.0;
  for (double x = 0.0; x <= 5.0; x += 0.01) {
    EXPECT_GE(curve(x), last - 1e-12);
    EXPECT_NEAR(curve.slope(x), (curve(x + 1e-6) - curve(x - 1e-6)) / 2e-6, 1e-4);
    last = curve(x);
  }
  EXPECT_THROW(MonotoneCurve({0, 0}, {1, 2}), InputError);
}

TEST(MonotoneCurve, FollowsAGammaCurveClosely) {
  std::vector<double> x, y;
  for (int level = 0; level <= 255; level += 5) {
    x.push_back(level);
    y.push_back(std::pow(level / 255.0, 2.2));
  }
  const MonotoneCurve curve(x, y);
  for (int level = 0; level < 256; ++level) EXPECT_NEAR(curve(level), std::pow(level / 255.0, 2.2), 2e-4);
}

TEST(NeverFalling, PoolsWhatFalls) {
  EXPECT_EQ(never_falling({1, 3, 2, 4}), (std::vector<double>{1, 2.5, 2.5, 4}));
  EXPECT_EQ(never_falling({3, 2, 1}), (std::vector<double>{2, 2, 2}));
  EXPECT_EQ(never_falling({1, 3, 2}, {1, 1, 3}), (std::vector<double>{1, 2.25, 2.25}));
}

TEST(CommonPeriod, IsTheLongestThatDividesAll) {
  EXPECT_NEAR(common_period({Seconds(0.0333), Seconds(0.05), Seconds(0.0834)}).count(), 1.0 / 60.0, 1e-4);
  EXPECT_EQ(common_period({Seconds(0.0333), Seconds(0.0512), Seconds(0.0707)}).count(), 0.0);
  EXPECT_EQ(common_period({}).count(), 0.0);
}

/// Frames of a free-running camera under light that pulses as a sine.
std::vector<ExposedLight> pulsing(double hz, double depth, double noise) {
  std::vector<ExposedLight> light;
  Rng random(5);
  double start = 0.0;
  for (int i = 0; i < 72; ++i) {
    const double exposure = 0.002 * std::pow(15.0, std::fmod(i * std::numbers::phi, 1.0));
    const double w = 2.0 * std::numbers::pi * hz;
    const double ripple = depth * (std::cos(w * start) - std::cos(w * (start + exposure))) / (w * exposure);
    light.push_back({start, exposure,
                     1000.0 * std::pow(exposure, 0.3) * (1.0 + ripple) * (1.0 + noise * random.normal())});
    start += 0.04 + 0.013 * random.uniform();
  }
  return light;
}

TEST(Ripples, AreFoundWithTheirFrequency) {
  for (double hz : {50.0, 100.0, 211.7, 960.0}) {
    const auto ripples = find_ripples(pulsing(hz, 0.1, 1e-3), 2);
    ASSERT_EQ(ripples.size(), 1u) << hz;
    EXPECT_NEAR(ripples[0].hz, hz, 0.02) << hz;
    EXPECT_NEAR(ripples[0].depth, 0.1, 0.01) << hz;
  }
}

TEST(Ripples, AreNotFoundInNoise) {
  EXPECT_TRUE(find_ripples(pulsing(100.0, 0.0, 0.01), 2).empty());
}

TEST(ExposureUnit, LeavesNoRipple) {
  const Ripple mains{100.0, 0.2}, backlight{240.0, 0.1};
  EXPECT_NEAR(exposure_unit_for({mains}, 1e-3).count(), 0.01, 1e-9);
  EXPECT_NEAR(exposure_unit_for({mains, backlight}, 1e-3).count(), 0.05, 1e-9);
  EXPECT_EQ(exposure_unit_for({}, 1e-3).count(), 0.0);
  EXPECT_NEAR(mains.error_at(Seconds(0.005)), 0.2 * 2.0 / std::numbers::pi, 1e-9);
}

ChangeFrame ramp_frame(double start, double exposure, double latency, double settling) {
  constexpr int steps = 2000;
  double share = 0.0;
  for (int i = 0; i < steps; ++i)
    share += std::clamp((start + exposure * (i + 0.5) / steps - latency) / settling, 0.0, 1.0) / steps;
  return {start, exposure, share};
}

TEST(DisplayTransition, IsFoundFromFramesInStepWithTheDisplay) {
  std::vector<ChangeFrame> frames;
  for (double exposure : {0.002, 0.008, 0.02, 0.033, 0.06, 0.1})
    for (double start = 0.0083; start < 0.3; start += std::max(0.0333, exposure))
      frames.push_back(ramp_frame(start, exposure, 0.0412, 0.0087));
  const DisplayTransition change = fit_light_change(frames, Seconds(0.5), 0.01);
  EXPECT_NEAR(change.latency.count(), 0.0412, 2e-4);
  EXPECT_NEAR((change.latency + change.settling).count(), 0.0412 + 0.0087, 2e-4);
}

TEST(DisplayTransition, SettlingCoversASlowTail) {
  std::vector<ChangeFrame> frames;
  for (double start = 0.0; start < 0.5; start += 0.01)
    frames.push_back({start, 0.004, start < 0.03 ? 0.0 : 1.0 - std::exp(-(start - 0.03) / 0.03)});
  const DisplayTransition change = fit_light_change(frames, Seconds(0.5), 0.01);
  EXPECT_GE((change.latency + change.settling).count(), 0.03 + 0.03 * std::log(100.0) - 0.01);
}

TEST(ResponseFit, RefusesTooLittleLight) {
  std::vector<ResponseDatum> data;
  for (int i = 0; i < 400; ++i) data.push_back({i % 20, 0.01 * (1 + i / 20), 64.0 + i, 1.0});
  EXPECT_THROW(fit_response(data, 64.0, 4000.0), InputError);
}

TEST(ExposureSeries, KeepsToTheCameraAndToWholePeriods) {
  CameraDescription camera;
  camera.shortest_exposure = Seconds(0.001);
  camera.longest_exposure = Seconds(0.5);
  const auto free = exposure_series(camera, Seconds(0.0001), Seconds(10), 4, Seconds(0));
  ASSERT_EQ(free.size(), 4u);
  EXPECT_NEAR(free.front().count(), 0.001, 1e-12);
  EXPECT_NEAR(free.back().count(), 0.5, 1e-12);
  const auto whole = exposure_series(camera, Seconds(0.001), Seconds(0.1), 8, Seconds(0.01));
  EXPECT_LT(whole.size(), 8u);
  for (Seconds exposure : whole) EXPECT_NEAR(std::remainder(exposure.count(), 0.01), 0.0, 1e-9);
}

}  // namespace
}  // namespace refield
