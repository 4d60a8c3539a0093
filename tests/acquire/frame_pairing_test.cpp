// SPDX-License-Identifier: Apache-2.0
#include "acquire/capture/frame_pairing.h"

#include <gtest/gtest.h>

#include "acquire/hdr/hdr_merge.h"
#include "core/base/errors.h"
#include "tests/acquire/fake_rig.h"

namespace refield {
namespace {

using test::FakeRig;
using test::FakeRigHabits;

constexpr Seconds short_exposure{0.005};
constexpr Seconds long_exposure{0.013};

/// Shows alternating patterns and checks that every frame is of its own pattern, with its own exposure.
PairingCounts expect_only_right_pairs(FakeRig& rig, Trigger* trigger = nullptr,
                                      const std::optional<TimingCalibration>& timing = std::nullopt) {
  FramePairing pairing(rig.camera(), rig.illuminator(), trigger, timing);
  const auto camera = rig.camera_calibration();
  const auto monitor = rig.monitor_calibration();
  for (int pattern = 0; pattern < 12; ++pattern) {
    const auto level = static_cast<std::uint8_t>(pattern % 2 ? 255 : 20 * pattern);
    pairing.show(uniform_drive(FakeRig::width, FakeRig::height, level));
    for (Seconds exposure : {short_exposure, long_exposure}) {
      const RawFrame frame = pairing.photograph(exposure, 1.0);
      EXPECT_NEAR(frame.exposure.count(), exposure.count(), 0.01 * exposure.count());
      const Photograph merged = merge_exposures(std::span(&frame, 1), camera);
      for (int y = 0; y < FakeRig::height; ++y)
        for (int x = 0; x < FakeRig::width; ++x) {
          const float expected =
              rig.reflectance(x, y) * monitor.radiance_from_level[0][level] + FakeRig::ambient;
          EXPECT_NEAR(merged.radiance.at(x, y, 0), expected, 0.6 / (1e5 * exposure.count()))
              << "pattern " << pattern;
        }
    }
  }
  return pairing.counts();
}

TEST(FramePairing, NeverTakesAnEarlyFrame) {
  FakeRig rig;
  EXPECT_GT(expect_only_right_pairs(rig).early, 12u);
}

TEST(FramePairing, CopesWithLongLatencyAndDeepQueues) {
  FakeRigHabits habits;
  habits.latency = Seconds(0.25);
  habits.settling = Seconds(0.1);
  habits.queue_frames = 9;
  habits.settings_delay = 7;
  FakeRig rig(habits);
  const auto counts = expect_only_right_pairs(rig);
  EXPECT_GT(counts.early, 12u * 9u);
  EXPECT_GT(counts.stale, 0u);
}

TEST(FramePairing, CountsLostFramesAndGoesOn) {
  FakeRigHabits habits;
  habits.lose_every = 5;
  FakeRig rig(habits);
  EXPECT_GT(expect_only_right_pairs(rig).lost, 3u);
}

TEST(FramePairing, AcceptsExposuresThatTheCameraRounds) {
  FakeRigHabits habits;
  habits.exposure_rounding = 3.3e-5;
  FakeRig rig(habits);
  expect_only_right_pairs(rig);
}

TEST(FramePairing, WaitsForTheMeasuredControlLatencyOfACameraThatStatesWhatWasAsked) {
  FakeRigHabits habits;
  habits.states_what_was_asked = true;
  habits.settings_delay = 3;
  FakeRig rig(habits);
  TimingCalibration timing;
  timing.display_latency = habits.latency;
  timing.display_settling = habits.settling;
  timing.control_latency_frames = 3;
  expect_only_right_pairs(rig, nullptr, timing);
}

TEST(FramePairing, TrustsMeasuredTimingRatherThanTheDriver) {
  FakeRig rig;
  TimingCalibration timing;
  timing.display_latency = Seconds(0.5);
  FramePairing pairing(rig.camera(), rig.illuminator(), nullptr, timing);
  pairing.show(uniform_drive(FakeRig::width, FakeRig::height, 9));
  pairing.photograph(short_exposure, 1.0);
  EXPECT_GT(pairing.counts().early, 0.5 / 0.008 - 2.0);
}

TEST(FramePairing, FiresTheTrigger) {
  FakeRig rig;
  expect_only_right_pairs(rig, &rig.trigger());
  EXPECT_EQ(rig.pulses(), rig.frames_delivered());
}

TEST(FramePairing, NamesTheCameraThatIgnoresItsSettings) {
  FakeRigHabits habits;
  habits.automatic_exposure = true;
  FakeRig rig(habits);
  FramePairing pairing(rig.camera(), rig.illuminator(), nullptr);
  pairing.show(uniform_drive(FakeRig::width, FakeRig::height, 9));
  try {
    pairing.photograph(Seconds(0.3), 1.0);
    FAIL() << "a frame with other settings was taken";
  } catch (const DeviceError& error) {
    EXPECT_NE(std::string(error.what()).find("automatic exposure"), std::string::npos) << error.what();
  }
}

TEST(FramePairing, PassesOnThatTheCameraIsGone) {
  FakeRigHabits habits;
  habits.unplugged_after = 3;
  FakeRig rig(habits);
  FramePairing pairing(rig.camera(), rig.illuminator(), nullptr);
  pairing.show(uniform_drive(FakeRig::width, FakeRig::height, 9));
  EXPECT_THROW(pairing.photograph(short_exposure, 1.0), DeviceError);
}

/// Hands the same frame over twice, as drivers do after a hiccup.
class RepeatingCamera : public Camera {
 public:
  explicit RepeatingCamera(Camera& camera) : camera_(camera) {}
  CameraDescription describe() const override { return camera_.describe(); }
  TimePoint set_exposure(Seconds exposure, double gain) override {
    return camera_.set_exposure(exposure, gain);
  }
  RawFrame next_frame(Seconds timeout) override {
    repeat_ = !repeat_;
    if (!repeat_) return last_;
    return last_ = camera_.next_frame(timeout);
  }

 private:
  Camera& camera_;
  RawFrame last_;
  bool repeat_ = false;
};

TEST(FramePairing, TakesNoFrameTwice) {
  FakeRig rig;
  RepeatingCamera camera(rig.camera());
  FramePairing pairing(camera, rig.illuminator(), nullptr);
  pairing.show(uniform_drive(FakeRig::width, FakeRig::height, 9));
  std::uint64_t last = 0;
  for (int i = 0; i < 6; ++i) {
    const RawFrame frame = pairing.photograph(short_exposure, 1.0);
    EXPECT_GT(frame.sequence, last);
    last = frame.sequence;
  }
}

}  // namespace
}  // namespace refield
