// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "acquire/drm_atomic.h"
#include "acquire/drm_display.h"
#include "core/units.h"

namespace refield {

/// A frame buffer of 8-bit XRGB in the card's memory that the processor can write ("dumb buffer").
struct DrmBuffer {
  std::uint32_t handle = 0;
  std::uint32_t frame_buffer = 0;
  std::size_t bytes_per_line = 0;
  std::span<std::uint8_t> bytes;
};

/// A display through Linux's KMS: one connector in one mode, whose frame buffers this program flips. By
/// atomic commits where the driver has them, else by the older calls. Colour tables are switched off and the
/// full range of levels is asked for, so that the monitor is sent what is in the buffer.
class DrmDevice {
 public:
  /// Throws DeviceError when the card cannot be opened, another program (a desktop) holds it, its flips are
  /// not stamped by the monotonic clock, or no controller can drive the connector.
  DrmDevice(const DrmConnectorInfo& connector, std::size_t mode);
  ~DrmDevice();
  DrmDevice(const DrmDevice&) = delete;
  DrmDevice& operator=(const DrmDevice&) = delete;

  bool is_atomic() const { return atomic_; }
  DrmBuffer make_buffer(int width, int height);
  /// Sets the mode with `buffer` on the screen.
  void light_up(const DrmBuffer& buffer);
  /// Puts `buffer` on the screen; returns when it is there, with the flip's time stamp. Throws DeviceError
  /// when the flip is not confirmed within two seconds.
  TimePoint flip(const DrmBuffer& buffer);
  /// Throws DeviceError when the monitor was unplugged or switched off.
  void require_monitor() const;

 private:
  [[noreturn]] void fail(int error_number, const std::string& what) const;
  void choose_objects();
  DrmConnectorInfo connector_;
  std::size_t mode_;
  int descriptor_ = -1;
  bool atomic_ = false;
  DrmPipeline pipeline_;
  std::vector<DrmBuffer> buffers_;
  std::optional<TimePoint> flipped_;  // the kernel holds its address while a flip is on its way
};

}  // namespace refield
