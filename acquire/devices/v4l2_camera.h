// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "acquire/devices/tethered_camera.h"
#include "acquire/devices/v4l2_device.h"
#include "core/base/run_context.h"

namespace refield {

/// Controls of a V4L2 camera for measuring: whatever the camera would choose by itself is switched off, and
/// every setting is read back.
class V4l2Settings {
 public:
  /// Switches automatic modes off, then makes the `wanted` settings (by v4l2-ctl's names). Throws InputError
  /// for a control that is not there or a value out of its range, DeviceError when the camera keeps choosing
  /// its exposure, gain or white balance, or reads back another value than was set.
  V4l2Settings(const V4l2Device& device, const std::map<std::string, std::int64_t>& wanted);

  /// Sentences about automatic modes that would not be switched off but may do no harm.
  const std::vector<std::string>& warnings() const { return warnings_; }

  /// Range of the exposure control; nullopt when there is none.
  const std::optional<V4l2ControlInfo>& exposure() const { return exposure_; }
  const std::optional<V4l2ControlInfo>& gain() const { return gain_; }

  /// Sets a control and returns what it reads back.
  std::int64_t set(const V4l2ControlInfo& control, std::int64_t value) const;

 private:
  const V4l2ControlInfo* find(std::uint32_t id) const;
  void switch_off_automatic_modes(const std::map<std::string, std::int64_t>& wanted);
  void make(const std::map<std::string, std::int64_t>& wanted);
  const V4l2Device& device_;
  std::vector<V4l2ControlInfo> controls_;
  std::vector<std::string> warnings_;
  std::optional<V4l2ControlInfo> exposure_, gain_;
};

/// `device` is a node, bus or card name, see find_v4l2_camera(); `format` a code such as "RGGB". Without
/// `unit_gain` the gain control stays as it is, and only gain 1 is taken.
struct V4l2CameraOptions : CameraOptions {
  int width = 0;  ///< 0: what the driver is set to
  int height = 0;
  std::map<std::string, std::int64_t> controls;  ///< by v4l2-ctl's names; all are read back
  Seconds fixed_exposure{0};                     ///< of a camera without an exposure control
};

/// A camera through Linux's V4L2, with memory-mapped streaming.
///
/// RawFrame::exposure_start never lies after the true start of exposure: a driver that stamps the end of the
/// frame is taken to have read it out for a whole frame interval, after the longest exposure that may have
/// been in effect. Sequence numbers go on across restarts and replugging. Damaged frames, frames handed over
/// twice and the first frames after a start are left out.
class V4l2Camera final : public TetheredCamera {
 public:
  /// Throws InputError for options that the camera cannot do, DeviceError when it refuses. `run` receives
  /// notes about damaged frames and an unplugged camera, and stops waiting.
  explicit V4l2Camera(V4l2CameraOptions options, RunContext run = {});
  ~V4l2Camera() override;

  CameraDescription describe() const override;
  TimePoint set_exposure(Seconds exposure, double gain) override;
  /// Waits for an unplugged camera to come back. Throws DeviceError when it does not, when no frame comes in
  /// time, or when stamps are not of the monotonic clock.
  RawFrame next_frame(Seconds timeout) override;

  const CameraTroubles& troubles() const override;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace refield
