// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "acquire/v4l2_device.h"

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

}  // namespace refield
