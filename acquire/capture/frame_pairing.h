// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "acquire/calibrate/calibration.h"
#include "acquire/camera.h"
#include "acquire/illuminator.h"

namespace refield {

/// Frames that came but could not be used.
struct PairingCounts {
  std::uint64_t early = 0;  ///< exposure began before the pattern stood still
  std::uint64_t stale = 0;  ///< may have settings from before the last change, or were handed over twice
  std::uint64_t lost = 0;   ///< gaps in the camera's numbering
};

/// Pairs frames with patterns by time stamps, never by waiting: a frame belongs to a pattern only when its
/// exposure began after the flip's time stamp plus the display's latency and settling, with the settings that
/// were asked for: it says so, and it began later than the change by the camera's control latency. Whatever
/// delays the display, the driver or this process may add, a wrong pair cannot come about.
class FramePairing {
 public:
  /// `trigger` may be null: the camera then runs freely. Without `timing`, the display's latency and settling
  /// are what its driver states, and the camera's settings act at once.
  FramePairing(Camera& camera, Illuminator& illuminator, Trigger* trigger,
               const std::optional<TimingCalibration>& timing = std::nullopt);

  void show(const DriveImage& pattern);

  /// Asks for the settings ahead of show(), so that they act while the pattern settles.
  void prepare(Seconds exposure, double gain);

  /// A frame of the pattern shown last, with these settings. The frame's own `exposure` is what the camera
  /// reports; it may differ from the request by what cameras round to. Throws DeviceError when frames stop
  /// coming, have the wrong size, or never take on the settings.
  RawFrame photograph(Seconds exposure, double gain);

  const PairingCounts& counts() const { return counts_; }

 private:
  bool usable(const RawFrame& frame, Seconds exposure, double gain);
  bool has_settings(const RawFrame& frame);
  Camera& camera_;
  Illuminator& illuminator_;
  Trigger* trigger_;
  CameraDescription description_;
  Seconds change_{0};  // display's latency and settling
  std::uint64_t control_latency_ = 0;
  TimePoint settled_{};  // from here on the light is the pattern's
  TimePoint settings_made_{};
  std::optional<std::uint64_t> first_since_settings_;  // sequence of the first frame begun after that
  Seconds asked_exposure_{0};
  Seconds longest_pending_{0};  // frames on their way may have been asked for with this
  double asked_gain_ = 0.0;
  std::optional<std::uint64_t> last_sequence_;
  PairingCounts counts_;
};

}  // namespace refield
