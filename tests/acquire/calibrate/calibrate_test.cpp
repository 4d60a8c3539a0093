// SPDX-License-Identifier: Apache-2.0
// Whole calibrations of virtual rigs whose truth is known.
#include "acquire/calibrate/calibrate.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "core/base/errors.h"
#include "tests/acquire/calibrate/known_rig.h"

namespace refield {
namespace {

using test::known_rig;
using test::View;

// What a calibration must reach.
constexpr double curve_rms = 0.005;     // of the range: response and tone curves
constexpr double noise_figures = 0.05;  // relative: gain and read noise
constexpr double time_s = 0.001;        // a thirtieth of a frame

/// RMS difference of the measured response from the sensor's, both from 0 at black to 1 at saturation.
double response_error(const CameraCalibration& measured, const SensorModel& sensor) {
  const double full = sensor.full_scale();
  const auto truth = [&](double dn) {
    return full * std::pow(dn / full, sensor.response_gamma) - sensor.black_level_dn;
  };
  const auto got = [&](int dn) { return measured.linear_from_dn[dn] - measured.black_level_dn; };
  const auto first = static_cast<int>(std::ceil(measured.black_level_dn));
  const auto last = static_cast<int>(measured.saturation_dn);
  double squares = 0.0;
  for (int dn = first; dn <= last; ++dn)
    squares += std::pow(got(dn) / got(last) - truth(dn) / truth(last), 2) / (last - first + 1);
  return std::sqrt(squares);
}

double tone_error(const MonitorCalibration& measured, const MonitorModel& monitor, int channel) {
  const auto curve = monitor.tone_curve()[channel];
  double squares = 0.0;
  for (int level = 0; level < 256; ++level)
    squares += std::pow(measured.radiance_from_level[channel][level] -
                            (curve[level] - curve[0]) / (curve[255] - curve[0]),
                        2) /
               256.0;
  return std::sqrt(squares);
}

/// What the tolerances are held to, for whoever wants to know by how much.
void print_figures(const RigMeasurements& measured, const MonitorModel& monitor, const SensorModel& sensor) {
  const auto per_cent = [](double value, double truth) { return 100.0 * (value / truth - 1.0); };
  std::printf(
      "response %.3f %% RMS; tone curves %.3f, %.3f, %.3f %% RMS\n",
      100.0 * response_error(measured.camera, sensor), 100.0 * tone_error(measured.monitor, monitor, 0),
      100.0 * tone_error(measured.monitor, monitor, 1), 100.0 * tone_error(measured.monitor, monitor, 2));
  std::printf("electrons at saturation (gain) %+.2f %%, read noise %+.2f %%\n",
              per_cent(measured.noise.full_well_electrons, sensor.full_well_electrons),
              per_cent(measured.noise.read_noise_electrons, sensor.read_noise_electrons));
  std::printf("display latency %+.3f ms, with settling %+.3f ms; control latency %d of %d frames\n",
              1e3 * (measured.timing.display_latency - monitor.latency).count(),
              1e3 * (measured.timing.display_latency + measured.timing.display_settling - monitor.latency -
                     monitor.settling)
                        .count(),
              measured.control_latency.frames, sensor.control_latency_frames);
}

/// Electrons that a linear DN stands for follow from the scale of the table, which is free: compared are
/// electrons.
void expect_truth(const RigMeasurements& measured, const MonitorModel& monitor, const SensorModel& sensor) {
  print_figures(measured, monitor, sensor);
  EXPECT_EQ(measured.control_latency.frames, sensor.control_latency_frames);
  EXPECT_LT(response_error(measured.camera, sensor), curve_rms);
  const double full = sensor.full_scale();
  EXPECT_NEAR(measured.black.dn, full * std::pow(sensor.black_level_dn / full, 1.0 / sensor.response_gamma),
              0.3);
  EXPECT_NEAR(measured.noise.full_well_electrons, sensor.full_well_electrons,
              noise_figures * sensor.full_well_electrons);
  EXPECT_NEAR(measured.noise.read_noise_electrons, sensor.read_noise_electrons,
              noise_figures * sensor.read_noise_electrons);
  EXPECT_NEAR(measured.timing.display_latency.count(), monitor.latency.count(), time_s);
  EXPECT_NEAR((measured.timing.display_latency + measured.timing.display_settling).count(),
              (monitor.latency + monitor.settling).count(), time_s);
  EXPECT_NEAR(measured.timing.refresh_period.count(), monitor.refresh_interval.count(), 1e-6);
  for (int c = 0; c < 3; ++c) EXPECT_LT(tone_error(measured.monitor, monitor, c), curve_rms) << c;
  EXPECT_TRUE(measured.superposition.holds());
}

TEST(Calibrate, RecoversALinearCameraAndASteadyDisplay) {
  MonitorModel monitor;
  monitor.gamma = {2.2, 2.3, 2.1};
  SensorModel sensor;
  sensor.control_latency_frames = 2;
  VirtualRig rig = known_rig(View::scene, monitor, sensor);
  const RigMeasurements measured = calibrate(rig.camera(), rig.illuminator(), nullptr, {});
  expect_truth(measured, monitor, sensor);
  EXPECT_TRUE(measured.response.is_linear);
  EXPECT_EQ(measured.camera.saturation_dn, 3814.0);
  EXPECT_NEAR(measured.noise.electrons_per_dn, sensor.electrons_per_dn,
              noise_figures * sensor.electrons_per_dn);
  EXPECT_TRUE(measured.banding.ripples.empty());
  EXPECT_EQ(measured.timing.exposure_unit.count(), 0.0);
  EXPECT_TRUE(measured.warnings.empty()) << measured.warnings.front();
}

TEST(Calibrate, RecoversABentTriggeredBayerCameraUnderAPulsingBacklight) {
  MonitorModel monitor;
  monitor.gamma = {1.8, 2.0, 2.4};
  monitor.latency = Seconds(0.071);
  monitor.settling = Seconds(0.023);
  monitor.pwm_hz = 240.0;
  monitor.pwm_depth = 0.3;
  SensorModel sensor;
  sensor.layout = PixelLayout::bayer_rggb;
  sensor.response_gamma = 2.2;
  sensor.control_latency_frames = 3;
  sensor.latency_frames = 4;
  sensor.read_noise_electrons = 5.0;
  VirtualRig rig = known_rig(View::scene, monitor, sensor);
  const RigMeasurements measured = calibrate(rig.camera(), rig.illuminator(), &rig.trigger(), {});
  expect_truth(measured, monitor, sensor);
  EXPECT_FALSE(measured.response.is_linear);
  ASSERT_EQ(measured.banding.ripples.size(), 1u);
  EXPECT_NEAR(measured.banding.ripples[0].hz, 240.0, 0.05);
  constexpr double first_harmonic = 4.0 / 3.14159 * 0.3;  // of a square wave
  EXPECT_NEAR(measured.banding.ripples[0].depth, first_harmonic, 0.2 * first_harmonic);
  EXPECT_NEAR(measured.timing.exposure_unit.count(), 1.0 / 240.0, 1e-6);
  ASSERT_EQ(measured.warnings.size(), 1u);
  EXPECT_NE(measured.warnings[0].find("whole multiples of 0.004167 s"), std::string::npos)
      << measured.warnings[0];
}

TEST(Calibrate, EightBitsOfAGammaCameraStillGiveGainAndCurves) {
  SensorModel sensor;
  sensor.bits = 8;
  sensor.response_gamma = 2.2;
  sensor.electrons_per_dn = 64.0;
  sensor.black_level_dn = 4.0;
  VirtualRig rig = known_rig(View::scene, {}, sensor);
  const RigMeasurements measured = calibrate(rig.camera(), rig.illuminator(), nullptr, {});
  constexpr double rounding = 1.0 / 255.0;
  EXPECT_LT(response_error(measured.camera, sensor), curve_rms + rounding);
  // Read noise is a fraction of a DN there: beyond measuring.
  EXPECT_NEAR(measured.noise.full_well_electrons, sensor.full_well_electrons,
              0.1 * sensor.full_well_electrons);
  for (int c = 0; c < 3; ++c) EXPECT_LT(tone_error(measured.monitor, {}, c), curve_rms) << c;
}

const std::vector<Seconds> bracket = {Seconds(0.05), Seconds(0.2)};

Superposition superposition_under(double dimming) {
  MonitorModel monitor;
  monitor.dimming = dimming;
  const SensorModel sensor;
  VirtualRig rig = known_rig(View::scene, monitor, sensor);
  CalibrationBench bench(rig.camera(), rig.illuminator(), nullptr, 1.0, Seconds(0.2));
  return measure_superposition(bench, test::true_calibration(sensor), bracket);
}

TEST(Superposition, HoldsForLightThatAddsUp) {
  const Superposition result = superposition_under(0.0);
  EXPECT_TRUE(result.holds());
  EXPECT_LT(result.largest_error(), 0.002);
}

TEST(Superposition, DetectsDynamicDimmingOfFivePerCent) {
  const Superposition result = superposition_under(0.05);
  EXPECT_FALSE(result.holds());
  // Halves are dimmed by 2.5 %, the whole by 5 %.
  EXPECT_NEAR(result.pairs[0].error, 0.975 / 0.95 - 1.0, 0.002);
}

TEST(FlatField, RecoversVignettingToHalfAPerCent) {
  SensorModel sensor;
  sensor.vignetting = 0.35;
  VirtualRig rig = known_rig(View::card, {}, sensor);
  CalibrationBench bench(rig.camera(), rig.illuminator(), nullptr, 1.0, Seconds(0.2));
  const UniformityMap result = measure_flat_field(bench, test::true_calibration(sensor), bracket);
  double squares = 0.0;
  for (int y = 0; y < test::known_height; ++y)
    for (int x = 0; x < test::known_width; ++x) {
      const double u = (x + 0.5) / test::known_width, v = (y + 0.5) / test::known_height;
      const double dx = (u - 0.5) * test::known_width, dy = (v - 0.5) * test::known_height;
      squares +=
          std::pow(result.map.at(u, v) - (1.0 - 0.35 * (dx * dx + dy * dy) / (32.0 * 32.0 + 24.0 * 24.0)), 2);
    }
  EXPECT_LT(std::sqrt(squares / (test::known_height * test::known_width)), 0.005);
  EXPECT_LT(result.texture, 0.005);
}

TEST(FlatField, SaysThatASceneIsNoCard) {
  const SensorModel sensor;
  VirtualRig rig = known_rig(View::scene, {}, sensor);
  CalibrationBench bench(rig.camera(), rig.illuminator(), nullptr, 1.0, Seconds(0.2));
  try {
    measure_flat_field(bench, test::true_calibration(sensor), bracket);
    FAIL() << "a scene passed for plain card";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("white card"), std::string::npos) << error.what();
  }
}

TEST(ScreenUniformity, IsRecoveredBehindAVignettingLensToOnePerCent) {
  MonitorModel monitor;
  monitor.falloff = 0.25;
  SensorModel sensor;
  sensor.vignetting = 0.3;
  VirtualRig rig = known_rig(View::screen, monitor, sensor);
  CalibrationBench bench(rig.camera(), rig.illuminator(), nullptr, 1.0, Seconds(0.2));
  CameraCalibration camera = test::true_calibration(sensor);
  camera.flat_field = {17, 13, {}};
  for (int j = 0; j < 13; ++j)
    for (int i = 0; i < 17; ++i) {
      const double dx = (i / 16.0 - 0.5) * test::known_width, dy = (j / 12.0 - 0.5) * test::known_height;
      camera.flat_field.values.push_back(
          static_cast<float>(1.0 - 0.3 * (dx * dx + dy * dy) / (32.0 * 32.0 + 24.0 * 24.0)));
    }
  const UniformityMap result = measure_screen_uniformity(bench, camera, bracket);
  for (double u : {0.1, 0.35, 0.5, 0.9})
    for (double v : {0.1, 0.5, 0.8}) {
      const double dx = (u - 0.5) * 64.0, dy = (v - 0.5) * 48.0;
      EXPECT_NEAR(result.map.at(u, v) / result.map.at(0.5, 0.5),
                  1.0 - 0.25 * (dx * dx + dy * dy) / (32.0 * 32.0 + 24.0 * 24.0), 0.01)
          << u << ", " << v;
    }
}

}  // namespace
}  // namespace refield
