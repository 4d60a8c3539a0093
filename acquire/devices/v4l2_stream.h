// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "acquire/devices/v4l2_device.h"
#include "core/base/run_context.h"
#include "core/base/units.h"

namespace refield {

/// What a V4L2 node is asked for before it streams; zero or empty leaves the driver's present choice.
struct V4l2StreamRequest {
  std::uint32_t fourcc = 0;
  int width = 0;
  int height = 0;
  double rate = 0.0;  ///< frames per second
  int buffers = 4;
};

/// What the driver made of it.
struct V4l2StreamFormat {
  std::uint32_t fourcc = 0;
  int width = 0;
  int height = 0;
  std::size_t bytes_per_line = 0;
  bool bt709 = false;       ///< of YUV formats: luma weights of BT.709, else of BT.601
  bool full_range = false;  ///< of YUV formats
  Seconds frame_interval{0};
};

/// One buffer as the driver filled it. `bytes` are valid until it is given back.
struct V4l2Filled {
  std::uint32_t index = 0;
  std::span<const std::uint8_t> bytes;
  TimePoint stamp{};
  bool is_end_of_frame = false;  ///< the stamp tells when the frame's last byte came, not when exposure began
  bool is_monotonic = false;     ///< the stamp is of CLOCK_MONOTONIC
  bool is_damaged = false;       ///< V4L2_BUF_FLAG_ERROR
  std::uint32_t sequence = 0;    ///< as the driver counts, wrapping at 2^32
};

/// Memory-mapped streaming from a V4L2 node, which must outlive it.
class V4l2Stream {
 public:
  /// Sets format and rate and starts. Throws InputError when the driver chose another format or size than was
  /// asked for, DeviceError when it refuses.
  V4l2Stream(const V4l2Device& device, const V4l2StreamRequest& request, RunContext run = {});
  ~V4l2Stream();
  V4l2Stream(const V4l2Stream&) = delete;
  V4l2Stream& operator=(const V4l2Stream&) = delete;

  const V4l2StreamFormat& format() const { return format_; }

  /// The next filled buffer; nullopt after `timeout`. Throws DeviceError when streaming broke (EIO: restart()
  /// may mend it) or the device was unplugged (ENODEV), Interrupted when asked to stop.
  std::optional<V4l2Filled> take(Seconds timeout);
  void give_back(const V4l2Filled& buffer);
  /// False while an input such as HDMI has no source; frames then show nothing.
  bool has_signal() const;
  /// Stops and starts again, all buffers empty.
  void restart();

 private:
  void choose_format(const V4l2StreamRequest& request);
  void choose_rate(double rate);
  void map_buffers(int count);
  void unmap_buffers() noexcept;
  void start();
  bool wait_until_filled(Seconds timeout) const;

  const V4l2Device& device_;
  RunContext run_;
  V4l2StreamFormat format_;
  std::vector<std::span<std::uint8_t>> buffers_;
};

}  // namespace refield
