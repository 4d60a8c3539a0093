// SPDX-License-Identifier: Apache-2.0
// Rigs that cannot be calibrated, and what is said of them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "acquire/calibrate/calibrate.h"
#include "core/base/errors.h"
#include "tests/acquire/calibrate/known_rig.h"

namespace refield {
namespace {

using test::known_rig;
using test::View;
using testing::HasSubstr;

std::string refusal(Camera& camera, Illuminator& illuminator, const CalibrateOptions& options = {}) {
  try {
    calibrate(camera, illuminator, nullptr, options);
  } catch (const Error& error) {
    return error.what();
  }
  return "none";
}

std::string refusal_of(const MonitorModel& monitor, const SensorModel& sensor, float ambient = 0.01f,
                       const CalibrateOptions& options = {}) {
  VirtualRig rig = known_rig(View::scene, monitor, sensor, ambient);
  return refusal(rig.camera(), rig.illuminator(), options);
}

TEST(CalibrateFailure, SceneTooDark) {
  SensorModel sensor;
  sensor.longest_exposure = Seconds(0.001);
  EXPECT_THAT(refusal_of({}, sensor), HasSubstr("the scene is too dark"));
}

TEST(CalibrateFailure, RoomTooBright) {
  EXPECT_THAT(refusal_of({}, {}, 20.0f), HasSubstr("darken the room"));
}

TEST(CalibrateFailure, SaturatedAtTheShortestExposure) {
  SensorModel sensor;
  sensor.shortest_exposure = Seconds(0.5);
  sensor.sensitivity = 4e7;
  EXPECT_THAT(refusal_of({}, sensor), HasSubstr("too bright; close the aperture"));
}

TEST(CalibrateFailure, DisplaySlowerThanThePatience) {
  MonitorModel monitor;
  monitor.settling = Seconds(0.4);
  CalibrateOptions options;
  options.patience = Seconds(0.3);
  EXPECT_THAT(refusal_of(monitor, {}, 0.01f, options), HasSubstr("longer --patience"));
}

TEST(CalibrateFailure, OptionsOutOfRange) {
  CalibrateOptions options;
  options.tone_step = 7;
  EXPECT_THAT(refusal_of({}, {}, 0.01f, options), HasSubstr("give 1, 3, 5"));
}

/// A camera of whose frames another class changes something.
class AlteredCamera : public Camera {
 public:
  explicit AlteredCamera(Camera& camera) : camera_(camera) {}
  CameraDescription describe() const override { return camera_.describe(); }
  TimePoint set_exposure(Seconds exposure, double gain) override {
    return camera_.set_exposure(exposure, gain);
  }
  RawFrame next_frame(Seconds timeout) override { return camera_.next_frame(timeout); }

 protected:
  Camera& camera_;
};

/// States the exposure asked for, but exposes as it likes.
class StubbornCamera : public AlteredCamera {
 public:
  using AlteredCamera::AlteredCamera;
  TimePoint set_exposure(Seconds exposure, double) override {
    asked_ = exposure;
    return camera_.set_exposure(Seconds(0.02), 1.0);
  }
  RawFrame next_frame(Seconds timeout) override {
    RawFrame frame = camera_.next_frame(timeout);
    frame.exposure = asked_;
    return frame;
  }

 private:
  Seconds asked_{0};
};

TEST(CalibrateFailure, CameraIgnoresItsExposure) {
  VirtualRig rig = known_rig(View::scene, {}, {});
  StubbornCamera camera(rig.camera());
  EXPECT_THAT(refusal(camera, rig.illuminator()), HasSubstr("ignores its exposure"));
}

/// Rounds away all but the upper six bits, as strong compression does.
class CompressingCamera : public AlteredCamera {
 public:
  using AlteredCamera::AlteredCamera;
  RawFrame next_frame(Seconds timeout) override {
    RawFrame frame = camera_.next_frame(timeout);
    for (auto& sample : frame.samples) sample = static_cast<std::uint16_t>(sample / 64 * 64 + 32);
    return frame;
  }
};

TEST(CalibrateFailure, CameraCompressesItsNoiseAway) {
  VirtualRig rig = known_rig(View::card, {}, {});
  CompressingCamera camera(rig.camera());
  CalibrationBench bench(camera, rig.illuminator(), nullptr, 1.0, Seconds(0.2));
  CameraResponse response;
  response.linear_from_dn = linear_response(12);
  response.black_level_dn = 64.0;
  response.saturation_dn = 3814.0;
  const Metering metering = meter(bench, Seconds(0.03));
  try {
    measure_photon_transfer(bench, metering, response, Seconds(0));
    FAIL() << "rounding was taken for photon noise";
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("noise does not grow with light"));
  }
}

// A long exposure is had by dimming the display, but not so far that the light of the room is most of it.
TEST(CalibrateFailure, LightOfTheRoomBoundsHowFarTheDisplayIsDimmed) {
  VirtualRig dark = known_rig(View::scene, {}, {}, 0.0f), bright = known_rig(View::scene, {}, {}, 0.2f);
  const auto metering_of = [](VirtualRig& rig) {
    CalibrationBench bench(rig.camera(), rig.illuminator(), nullptr, 1.0, Seconds(0.2));
    return meter(bench, Seconds(1.0));
  };
  const Metering dimmed = metering_of(dark), less_dimmed = metering_of(bright);
  std::printf("level %d, exposure %.3g s in the dark; level %d, %.3g s with light of the room\n",
              dimmed.level, dimmed.exposure.count(), less_dimmed.level, less_dimmed.exposure.count());
  EXPECT_LT(dimmed.level, less_dimmed.level);
  EXPECT_LT(less_dimmed.dark_dn, 0.8 * less_dimmed.lit_dn);
}

/// Shows nothing, as a display that is switched off.
class DarkDisplay : public Illuminator {
 public:
  explicit DarkDisplay(Illuminator& display) : display_(display) {}
  IlluminatorDescription describe() const override { return display_.describe(); }
  TimePoint show(const DriveImage& image) override {
    return display_.show(uniform_drive(image.width, image.height, 0));
  }

 private:
  Illuminator& display_;
};

TEST(CalibrateFailure, DisplayIsOff) {
  VirtualRig rig = known_rig(View::scene, {}, {});
  DarkDisplay display(rig.illuminator());
  EXPECT_THAT(refusal(rig.camera(), display), HasSubstr("the scene is too dark, or the room is too bright"));
}

}  // namespace
}  // namespace refield
