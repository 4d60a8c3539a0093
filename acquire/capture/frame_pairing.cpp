// SPDX-License-Identifier: Apache-2.0
#include "acquire/capture/frame_pairing.h"

#include <cerrno>
#include <cmath>

#include "acquire/capture/exposure_plan.h"

namespace refield {

namespace {

// Cameras round exposures to whole sensor lines and gains to steps.
constexpr double setting_tolerance = 0.01;
// Settings take 2 to 4 frames to act on real cameras; much later means that they never will.
constexpr int max_stale_frames = 64;
constexpr int max_early_frames = 100'000;
constexpr Seconds patience{5.0};  // beyond exposure and frame interval; a busy machine may stall for two

bool close_to(double value, double asked) {
  return std::abs(value - asked) <= setting_tolerance * asked;
}

std::size_t samples_of(const CameraDescription& camera) {
  return static_cast<std::size_t>(camera.width) * camera.height * (camera.layout == PixelLayout::rgb ? 3 : 1);
}

}  // namespace

FramePairing::FramePairing(Camera& camera, Illuminator& illuminator, Trigger* trigger,
                           const std::optional<TimingCalibration>& timing)
    : camera_(camera), illuminator_(illuminator), trigger_(trigger), description_(camera.describe()) {
  const IlluminatorDescription display = illuminator.describe();
  change_ = timing ? timing->display_latency + timing->display_settling : display.latency + display.settling;
  longest_pending_ = description_.longest_exposure;  // what was before is not known
  if (timing) control_latency_ = static_cast<std::uint64_t>(timing->control_latency_frames);
}

void FramePairing::show(const DriveImage& pattern) {
  // Rounded up: a frame that begins within the last nanosecond of settling is early.
  settled_ = illuminator_.show(pattern) + std::chrono::ceil<TimePoint::duration>(change_);
}

void FramePairing::prepare(Seconds exposure, double gain) {
  exposure = settable_exposure(exposure, description_);
  if (exposure == asked_exposure_ && gain == asked_gain_) return;
  longest_pending_ = std::max({longest_pending_, asked_exposure_, exposure});
  settings_made_ = camera_.set_exposure(exposure, gain);
  first_since_settings_.reset();
  asked_exposure_ = exposure;
  asked_gain_ = gain;
}

RawFrame FramePairing::photograph(Seconds exposure, double gain) {
  exposure = settable_exposure(exposure, description_);
  prepare(exposure, gain);
  const auto early_before = counts_.early;
  const auto stale_before = counts_.stale;
  while (counts_.early - early_before < max_early_frames && counts_.stale - stale_before < max_stale_frames) {
    camera_.begin_after(settled_);
    if (trigger_) trigger_->fire();
    RawFrame frame = camera_.next_frame(longest_pending_ + 4 * description_.frame_interval + patience);
    if (!usable(frame, exposure, gain)) continue;
    longest_pending_ = exposure;
    return frame;
  }
  if (counts_.stale - stale_before == max_stale_frames)
    throw DeviceError(description_.name, EIO, "does not apply an exposure of ", exposure.count(),
                      " s at gain ", gain,
                      "; turn off automatic exposure, or plan exposures that it supports");
  throw DeviceError(description_.name, EIO,
                    "reports only exposures from before the pattern was shown; check that camera and display "
                    "stamp times with the same clock");
}

/// True once a frame began later than the last change of settings by the control latency. Lost frames count,
/// too.
bool FramePairing::has_settings(const RawFrame& frame) {
  if (frame.exposure_start < settings_made_) return false;
  if (!first_since_settings_) first_since_settings_ = frame.sequence;
  return frame.sequence >= *first_since_settings_ + control_latency_;
}

bool FramePairing::usable(const RawFrame& frame, Seconds exposure, double gain) {
  if (frame.width != description_.width || frame.height != description_.height ||
      frame.layout != description_.layout || frame.samples.size() != samples_of(description_))
    throw DeviceError(description_.name, EIO, "sent a frame of ", frame.width, "×", frame.height,
                      " pixels instead of ", description_.width, "×", description_.height);
  const bool repeated = last_sequence_ && frame.sequence <= *last_sequence_;
  if (last_sequence_ && frame.sequence > *last_sequence_ + 1)
    counts_.lost += frame.sequence - *last_sequence_ - 1;
  last_sequence_ = frame.sequence;
  const bool settings_act = has_settings(frame);
  if (frame.exposure_start < settled_) {
    ++counts_.early;
    return false;
  }
  if (repeated || !settings_act || !close_to(frame.exposure.count(), exposure.count()) ||
      !close_to(frame.gain, gain)) {
    ++counts_.stale;
    return false;
  }
  return true;
}

}  // namespace refield
