// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <deque>
#include <vector>

#include "acquire/calibrate/calibration.h"
#include "acquire/camera.h"
#include "acquire/illuminator.h"

namespace refield::test {

/// Ways in which real devices misbehave.
struct FakeRigHabits {
  Seconds latency{0.030};  ///< of the display
  Seconds settling{0.011};
  int queue_frames = 2;    ///< frames wait in the driver, exposed long before they are handed over
  int settings_delay = 3;  ///< frames until a new exposure acts
  bool states_what_was_asked = false;  ///< frames state the exposure asked for, even before it acts
  int lose_every = 0;                  ///< every n-th frame never arrives
  int unplugged_after = -1;            ///< frames; then next_frame() throws
  bool automatic_exposure = false;
  double exposure_rounding = 0.0;  ///< exposures become multiples of it
};

/// A small camera and display with perfect, noise-free light and imperfect timing. Pixel (x, y) sees texel
/// (x, y): radiance = reflectance · radiance(level) + ambient. While the display changes, every pixel is
/// dazzled: a frame paired too early cannot be overlooked.
class FakeRig {
 public:
  static constexpr int width = 6;
  static constexpr int height = 4;
  static constexpr float ambient = 0.05f;

  explicit FakeRig(FakeRigHabits habits = {});
  Camera& camera() { return camera_; }
  Illuminator& illuminator() { return display_; }
  Trigger& trigger() { return trigger_; }

  CameraCalibration camera_calibration() const;
  MonitorCalibration monitor_calibration() const;
  float reflectance(int x, int y) const { return 0.2f + 0.03f * static_cast<float>(x + width * y); }
  int frames_delivered() const { return delivered_; }
  int pulses() const { return pulses_; }

 private:
  struct CameraFace : Camera {
    explicit CameraFace(FakeRig& r) : rig(r) {}
    CameraDescription describe() const override;
    TimePoint set_exposure(Seconds exposure, double gain) override;
    RawFrame next_frame(Seconds timeout) override;
    FakeRig& rig;
  };
  struct DisplayFace : Illuminator {
    explicit DisplayFace(FakeRig& r) : rig(r) {}
    IlluminatorDescription describe() const override;
    TimePoint show(const DriveImage& image) override;
    FakeRig& rig;
  };
  struct TriggerFace : Trigger {
    explicit TriggerFace(FakeRig& r) : rig(r) {}
    TimePoint fire() override;
    FakeRig& rig;
  };
  struct Flip {
    TimePoint time;
    DriveImage image;
  };
  RawFrame expose();
  float radiance_at(TimePoint time, int x, int y, int c) const;

  FakeRigHabits habits_;
  CameraFace camera_{*this};
  DisplayFace display_{*this};
  TriggerFace trigger_{*this};
  TimePoint now_{};
  std::vector<Flip> flips_;
  std::deque<RawFrame> queue_;
  std::deque<Seconds> pending_exposures_;
  Seconds exposure_{0.01};
  Seconds asked_{0.01};
  std::uint64_t sequence_ = 0;
  int delivered_ = 0;
  int pulses_ = 0;
};

}  // namespace refield::test
