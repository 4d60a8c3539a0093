// SPDX-License-Identifier: Apache-2.0
#include "simulate/rig/virtual_rig.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "core/base/errors.h"
#include "tests/simulate/sensor_statistics.h"

namespace refield {
namespace {

constexpr int width = 12, height = 8;
constexpr LightDomain domain{16, 8, Parameterisation::monitor};
constexpr Seconds patience(10.0);

// A scene in which every pixel sees the mean of the monitor's left half.
ReflectanceField half_seer() {
  ReflectanceField field;
  field.width = width;
  field.height = height;
  field.basis = {domain, {}, {{0, 0, 8, 8}}};
  const std::uint32_t column = 0;
  const float weight[3] = {1.0f / 64, 1.0f / 64, 1.0f / 64};
  for (int p = 0; p < width * height; ++p) field.transfer.append_row({&column, 1}, weight);
  return field;
}

DriveImage pattern(std::uint8_t left, std::uint8_t right = 0) {
  DriveImage image{domain.width, domain.height, {}};
  for (int y = 0; y < domain.height; ++y)
    for (int x = 0; x < domain.width; ++x) image.levels.insert(image.levels.end(), 3, x < 8 ? left : right);
  return image;
}

SensorModel quiet_sensor() {  // noise far below the differences that the tests look for
  SensorModel sensor;
  sensor.sensitivity = 1e7;
  sensor.electrons_per_dn = 1e7 * 0.02 / 4000.0;  // white for 20 ms is nearly full scale
  sensor.full_well_electrons = 1e9;
  sensor.read_noise_electrons = 0.0;
  return sensor;
}

double mean_of(const RawFrame& frame) {
  double sum = 0.0;
  for (double v : frame.samples) sum += v;
  return sum / static_cast<double>(frame.samples.size());
}

// Shows a pattern and reads on until a frame was exposed after the light had settled, as a careful capture
// does.
RawFrame settled_frame(VirtualRig& rig, const DriveImage& image) {
  const TimePoint flip = rig.illuminator().show(image);
  const IlluminatorDescription monitor = rig.illuminator().describe();
  for (;;) {
    RawFrame frame = rig.camera().next_frame(patience);
    if (frame.exposure_start - flip >= monitor.latency + monitor.settling) return frame;
  }
}

TEST(VirtualRig, FrameShowsTransportOfTheEmittedLightPlusAmbient) {
  const SensorModel sensor = quiet_sensor();
  MonitorModel monitor;
  monitor.gamma = {1.8, 2.2, 2.6};
  monitor.black_level = 0.01;
  VirtualRig rig(half_seer(), Image(width, height, 3, 0.05f), monitor, sensor, 1);
  rig.camera().set_exposure(Seconds(0.01), 1.0);
  const RawFrame frame = settled_frame(rig, pattern(100, 255));
  EXPECT_EQ(frame.exposure, Seconds(0.01));
  for (int c = 0; c < 3; ++c) {
    const double emitted = 0.01 + 0.99 * std::pow(100.0 / 255.0, monitor.gamma[c]);
    EXPECT_NEAR(frame.samples[c], test::mean_dn(sensor, emitted + 0.05, Seconds(0.01), 1.0),
                10.0);  // shot noise: 1 to 3 DN
    EXPECT_NEAR(emitted, monitor.tone_curve()[c][100], 1e-12);
  }
}

TEST(VirtualRig, FramesTakenTooEarlyShowThePreviousPattern) {
  SensorModel sensor = quiet_sensor();
  sensor.latency_frames = 2;
  MonitorModel monitor;
  VirtualRig rig(half_seer(), {}, monitor, sensor, 1);
  rig.camera().set_exposure(Seconds(0.001), 1.0);
  const double bright = mean_of(settled_frame(rig, pattern(255)));
  const TimePoint flip = rig.illuminator().show(pattern(0));
  int before_flip = 0, unchanged = 0, changed = 0;
  for (int i = 0; i < 10; ++i) {
    const RawFrame frame = rig.camera().next_frame(patience);
    const double level = mean_of(frame);
    if (frame.exposure_start < flip) ++before_flip;
    if (frame.exposure_start < flip + std::chrono::round<std::chrono::nanoseconds>(monitor.latency)) {
      EXPECT_NEAR(level, bright, 0.02 * bright);
      ++unchanged;
    } else if (frame.exposure_start - flip >= monitor.latency + monitor.settling) {
      EXPECT_LT(level - sensor.black_level_dn, 0.02 * (bright - sensor.black_level_dn));
      ++changed;
    }
  }
  EXPECT_EQ(before_flip, 2);  // the frames that waited in the queue
  EXPECT_GE(unchanged, 3);
  EXPECT_GE(changed, 4);
}

TEST(VirtualRig, ExposureAcrossTheChangeSeesTheMixByTime) {
  SensorModel sensor = quiet_sensor();
  sensor.latency_frames = 0;
  MonitorModel monitor;
  monitor.black_level = 0.0;
  monitor.latency = Seconds(2.0 / 60.0);
  monitor.settling = Seconds(0.012);
  VirtualRig rig(half_seer(), {}, monitor, sensor, 1);
  settled_frame(rig, pattern(0));
  const Seconds exposure(0.1);
  rig.camera().set_exposure(exposure, 1.0);
  const TimePoint flip = rig.illuminator().show(pattern(120));
  const RawFrame frame = rig.camera().next_frame(patience);
  const Seconds dark = monitor.latency + monitor.settling / 2.0 - Seconds(frame.exposure_start - flip);
  const double share = 1.0 - dark / exposure;
  ASSERT_GT(share, 0.2);
  ASSERT_LT(share, 0.9);
  const double radiance = share * std::pow(120.0 / 255.0, 2.2);
  EXPECT_NEAR(mean_of(frame), test::mean_dn(sensor, radiance, exposure, 1.0),
              0.01 * test::mean_dn(sensor, radiance, exposure, 1.0));
}

TEST(VirtualRig, PhotographsDoNotDependOnWhatWasTakenBefore) {
  SensorModel sensor;  // with noise
  const auto rig_of = [&](std::uint64_t seed) {
    return VirtualRig(half_seer(), Image(width, height, 3, 0.02f), {}, sensor, seed);
  };
  const auto series = [](VirtualRig& rig, std::uint8_t level) {
    std::vector<std::vector<std::uint16_t>> frames;
    const TimePoint flip = rig.illuminator().show(pattern(level));
    for (double exposure : {0.004, 0.016, 0.064, 0.004}) {
      rig.camera().set_exposure(Seconds(exposure), 1.0);
      for (;;) {
        const RawFrame frame = rig.camera().next_frame(patience);
        if (Seconds(frame.exposure_start - flip) < Seconds(0.06) || frame.exposure != Seconds(exposure))
          continue;
        frames.push_back(frame.samples);
        break;
      }
    }
    return frames;
  };
  VirtualRig undisturbed = rig_of(5);
  series(undisturbed, 10);
  series(undisturbed, 200);
  const auto expected = series(undisturbed, 77);
  VirtualRig resumed = rig_of(5);  // as after a kill: straight to the third pattern
  EXPECT_EQ(series(resumed, 77), expected);
  EXPECT_NE(expected[0], expected[3]);  // the same settings again: fresh noise
  VirtualRig other = rig_of(6);
  EXPECT_NE(series(other, 77), expected);
}

TEST(VirtualRig, TimeFromFlipToFrameIsAlwaysTheSame) {
  VirtualRig rig(half_seer(), {}, {}, SensorModel{}, 1);
  std::vector<MonotonicClock::duration> delays;
  for (double exposure : {0.001, 0.05, 0.0123, 0.4}) {
    rig.camera().set_exposure(Seconds(exposure), 1.0);
    const TimePoint flip = rig.illuminator().show(pattern(50));
    for (int i = 0; i < 3; ++i) {
      const RawFrame frame = rig.camera().next_frame(patience);
      if (frame.exposure_start < flip) continue;
      delays.push_back(frame.exposure_start - flip);
      break;
    }
  }
  ASSERT_EQ(delays.size(), 4u);
  EXPECT_TRUE(std::ranges::all_of(delays, [&](auto d) { return d == delays[0]; }));
}

TEST(VirtualRig, SequenceIsConsecutiveAndTimeGoesOn) {
  VirtualRig rig(half_seer(), {}, {}, SensorModel{}, 1);
  RawFrame last = rig.camera().next_frame(patience);
  for (int i = 0; i < 6; ++i) {
    if (i == 3) rig.illuminator().show(pattern(9));
    const RawFrame frame = rig.camera().next_frame(patience);
    EXPECT_EQ(frame.sequence, last.sequence + 1);
    EXPECT_GE(frame.exposure_start - last.exposure_start, std::chrono::milliseconds(33));
    last = frame;
  }
}

TEST(VirtualRig, TriggerStartsTheNextExposure) {
  SensorModel sensor;
  sensor.latency_frames = 0;
  VirtualRig rig(half_seer(), {}, {}, sensor, 1);
  rig.camera().next_frame(patience);
  const TimePoint edge = rig.trigger().fire();
  EXPECT_EQ(rig.camera().next_frame(patience).exposure_start, edge);
}

TEST(VirtualRig, SettingsActAfterTheControlLatencyThoughFramesStateThemAtOnce) {
  SensorModel sensor = quiet_sensor();
  sensor.control_latency_frames = 2;
  sensor.latency_frames = 0;
  VirtualRig rig(half_seer(), {}, {}, sensor, 1);
  rig.camera().set_exposure(Seconds(0.004), 1.0);
  settled_frame(rig, pattern(255));
  for (int i = 0; i < 4; ++i) rig.camera().next_frame(patience);
  const double dark = mean_of(rig.camera().next_frame(patience));
  const TimePoint made = rig.camera().set_exposure(Seconds(0.016), 1.0);
  for (int i = 0; i < 5; ++i) {
    const RawFrame frame = rig.camera().next_frame(patience);
    EXPECT_GE(frame.exposure_start, made);
    EXPECT_EQ(frame.exposure, Seconds(0.016));
    EXPECT_NEAR(mean_of(frame) - sensor.black_level_dn, (i < 2 ? 1.0 : 4.0) * (dark - sensor.black_level_dn),
                0.01 * dark)
        << i;
  }
}

TEST(VirtualRig, BacklightPulsesAverageOutOverWholePeriods) {
  MonitorModel monitor;
  monitor.pwm_hz = 240.0;
  monitor.pwm_depth = 0.5;
  const auto at = [](double seconds) {
    return TimePoint(std::chrono::round<std::chrono::nanoseconds>(Seconds(seconds)));
  };
  EXPECT_NEAR(monitor.backlight(at(0.0), at(0.5 / 240.0)), 1.5, 1e-5);
  EXPECT_NEAR(monitor.backlight(at(0.5 / 240.0), at(1.0 / 240.0)), 0.5, 1e-5);
  EXPECT_NEAR(monitor.backlight(at(0.0123), at(0.0123 + 3.0 / 240.0)), 1.0, 1e-5);
}

TEST(VirtualRig, DimmingAndFalloffDarkenWhatIsEmitted) {
  MonitorModel monitor;
  monitor.black_level = 0.0;
  monitor.dimming = 0.05;
  EXPECT_NEAR(monitor.emitted(pattern(255, 255)).radiance.at(3, 3, 1), 0.95, 1e-6);
  EXPECT_NEAR(monitor.emitted(pattern(255, 0)).radiance.at(3, 3, 1), 0.975, 1e-6);
  monitor.dimming = 0.0;
  monitor.falloff = 0.3;
  const Image light = monitor.emitted(pattern(255, 255)).radiance;
  EXPECT_NEAR(light.at(0, 0, 0), 1.0 - 0.3 * (7.5 * 7.5 + 3.5 * 3.5) / (8.0 * 8.0 + 4.0 * 4.0), 1e-6);
}

TEST(VirtualRig, LensTakesLightFromTheCorners) {
  SensorModel sensor = quiet_sensor();
  sensor.vignetting = 0.4;
  const Image flat(width, height, 3, 0.5f);
  const auto samples = sensor.expose(flat, Seconds(0.01), 1.0, 1);
  const auto light = [&](int x, int y) {
    return samples[(static_cast<std::size_t>(y) * width + x) * 3] - sensor.black_level_dn;
  };
  const auto share = [](double dx, double dy) {
    return 1.0 - 0.4 * (dx * dx + dy * dy) / (6.0 * 6.0 + 4.0 * 4.0);
  };
  EXPECT_NEAR(light(0, 0) / light(6, 4), share(5.5, 3.5) / share(0.5, 0.5), 0.01);
}

TEST(VirtualRig, RefusesWhatDevicesRefuse) {
  VirtualRig rig(half_seer(), {}, {}, SensorModel{}, 1);
  EXPECT_THROW(rig.camera().set_exposure(Seconds(100.0), 1.0), InputError);
  EXPECT_THROW(rig.camera().set_exposure(Seconds(0.01), 0.5), InputError);
  EXPECT_THROW(rig.illuminator().show(DriveImage{3, 3, std::vector<std::uint8_t>(27)}), InputError);
  rig.camera().set_exposure(Seconds(1.0), 1.0);
  EXPECT_THROW(rig.camera().next_frame(Seconds(0.1)), DeviceError);
  EXPECT_THROW(VirtualRig(half_seer(), Image(3, 3, 3), {}, SensorModel{}, 1), InputError);
}

TEST(ImperfectRig, ChannelsSeeOtherPrimaries) {
  SensorModel sensor = quiet_sensor();
  sensor.mixing = {{{1.0, 0.2, 0.1}, {0.0, 1.0, 0.0}, {0.3, 0.0, 1.0}}};
  Image light(2, 1, 3);
  light.values = {1.0f, 2.0f, 3.0f, 0.0f, 1.0f, 0.0f};
  const std::vector<float> expected = {1.7f, 2.0f, 3.3f, 0.2f, 1.0f, 0.0f};
  EXPECT_THAT(sensor.mixed(light).values, testing::Pointwise(testing::FloatEq(), expected));
  EXPECT_EQ(quiet_sensor().mixed(light).values, light.values);
}

TEST(ImperfectRig, ShutterTimesAreRoundedToPowersOfTwo) {
  SensorModel sensor = quiet_sensor();
  EXPECT_EQ(sensor.true_exposure(Seconds(1.0 / 30)).count(), 1.0 / 30);
  sensor.rounds_exposures = true;
  for (const auto& [stated, open] :
       {std::pair{1.0 / 30, 1.0 / 32}, {1.0 / 15, 1.0 / 16}, {1.0 / 60, 1.0 / 64}})
    EXPECT_DOUBLE_EQ(sensor.true_exposure(Seconds(stated)).count(), open);
}

// Photographs differ by the stated deviations, all exposures of one alike, and another run gives the same.
TEST(ImperfectRig, BrightnessAndBalanceJitter) {
  SensorModel sensor = quiet_sensor();
  sensor.gain_jitter = 0.02;
  sensor.balance_jitter = 0.01;
  double all = 0.0, balance = 0.0;
  constexpr int photographs = 4000;
  for (int i = 0; i < photographs; ++i) {
    const auto factors = sensor.jitter(static_cast<std::uint64_t>(i));
    EXPECT_EQ(factors, sensor.jitter(static_cast<std::uint64_t>(i)));
    all += std::pow((factors[0] + factors[1] + factors[2]) / 3.0 - 1.0, 2.0) / photographs;
    balance += std::pow(factors[0] - factors[1], 2.0) / photographs;
  }
  EXPECT_NEAR(std::sqrt(all), std::hypot(0.02, 0.01 / std::sqrt(3.0)), 0.001);
  EXPECT_NEAR(std::sqrt(balance), 0.01 * std::sqrt(2.0), 0.0005);
  VirtualRig one(half_seer(), {}, {}, sensor, 1), two(half_seer(), {}, {}, sensor, 1);
  one.set_place(0.25, 0);
  two.set_place(0.25, 0);
  const RawFrame frame = settled_frame(one, pattern(200));
  EXPECT_EQ(frame.samples, settled_frame(two, pattern(200)).samples);
  EXPECT_NE(mean_of(frame), mean_of(settled_frame(two, pattern(100))));
  two.set_place(0.5, 0);
  EXPECT_NE(frame.samples, settled_frame(two, pattern(200)).samples);
}

TEST(ImperfectRig, RoomLightVariesAndIsAsItWasAtTheStart) {
  const SensorModel sensor = quiet_sensor();
  VirtualRig rig(half_seer(), Image(width, height, 3, 0.2f), {}, sensor, 1);
  rig.disturb({.room_variation = 0.5});
  const auto level = [&](double done) {
    rig.set_place(done, 0);
    return mean_of(settled_frame(rig, pattern(0))) - sensor.black_level_dn;
  };
  const double start = level(0.0);
  EXPECT_NEAR(level(1.0 / 6.0) / start, 1.5, 0.02);  // of what little the dark monitor adds
  EXPECT_NEAR(level(0.5) / start, 0.5, 0.02);
}

TEST(ImperfectRig, ARoomLightIsSwitchedOn) {
  const Disturbances disturbances{.room_light = {{0.25, 3.0}, {0.75, 0.0}}};
  EXPECT_EQ(disturbances.room(0.2), 1.0);
  EXPECT_EQ(disturbances.room(0.25), 3.0);
  EXPECT_EQ(disturbances.room(0.7), 3.0);
  EXPECT_EQ(disturbances.room(1.0), 0.0);
}

/// What half_seer() becomes where the camera has moved to `x`: the weights tell where.
TracedScene scene_at(double x, int width_px = width) {
  TracedScene scene{half_seer(), {}};
  for (float& weight : scene.transport.transfer.weight) weight *= static_cast<float>(1.0 + x);
  scene.transport.width = width_px;
  return scene;
}

TEST(ImperfectRig, EachPositionOfTheCameraIsRenderedOnce) {
  SensorModel sensor = quiet_sensor();
  VirtualRig rig(half_seer(), {}, {}, sensor, 1);
  std::vector<double> rendered;
  rig.disturb({.moves = {{0.5, 0.25, 0.0}, {0.75, -0.5, 0.0}}}, [&](const Disturbances::Move& to) {
    rendered.push_back(to.right_px);
    return scene_at(to.right_px);
  });
  const auto level = [&](double done) {
    rig.set_place(done, 0);
    return mean_of(settled_frame(rig, pattern(128))) - sensor.black_level_dn;
  };
  const double start = level(0.0);
  EXPECT_NEAR(level(0.49) / start, 1.0, 0.001);
  EXPECT_TRUE(rendered.empty());
  EXPECT_NEAR(level(0.5) / start, 1.25, 0.002);
  EXPECT_NEAR(level(0.7) / start, 1.25, 0.002);
  // The pattern that is shown when the camera moves is seen from the new position, too.
  rig.set_place(0.8, 0);
  EXPECT_NEAR((mean_of(rig.camera().next_frame(patience)) - sensor.black_level_dn) / start, 0.5, 0.002);
  EXPECT_NEAR(level(0.0) / start, 1.0, 0.001);  // back
  EXPECT_EQ(rendered, (std::vector{0.25, -0.5, 0.0}));
}

TEST(ImperfectRig, ASceneOfAnotherSizeIsRefused) {
  VirtualRig rig(half_seer(), {}, {}, quiet_sensor(), 1);
  EXPECT_THROW(rig.disturb({.moves = {{0.5, 1.0, 0.0}}}), InputError);
  rig.disturb({.moves = {{0.5, 1.0, 0.0}}}, [](const auto&) { return scene_at(0.0, width / 2); });
  rig.set_place(0.5, 0);
  EXPECT_THROW(rig.camera().next_frame(patience), InputError);
}

TEST(ImperfectRig, TheMixingOfTheTransportIsNotAppliedTwice) {
  SensorModel sensor = quiet_sensor();
  sensor.mixing = {{{1.0, 0.5, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}}};
  ReflectanceField transport = half_seer();
  transport.output_from_primaries = sensor.mixing_matrix();
  VirtualRig one(transport, {}, {}, sensor, 1), two(half_seer(), {}, {}, sensor, 1);
  EXPECT_EQ(settled_frame(one, pattern(128)).samples, settled_frame(two, pattern(128)).samples);
}

TEST(ImperfectRig, ACalibrationMayStateAnotherToneCurve) {
  MonitorModel monitor;
  EXPECT_EQ(monitor.as_stated().gamma, monitor.gamma);
  monitor.stated_gamma = {2.0, 2.1, 2.2};
  EXPECT_EQ(monitor.as_stated().gamma, (std::array{2.0, 2.1, 2.2}));
}

}  // namespace
}  // namespace refield
