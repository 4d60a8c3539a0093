// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/units.h"

namespace refield {

/// An open V4L2 node. Every call names the device in its errors, and says so in clear words when the device
/// was unplugged.
class V4l2Device {
 public:
  /// Throws DeviceError when the node is missing, busy or may not be opened.
  explicit V4l2Device(const std::filesystem::path& node);
  ~V4l2Device();
  V4l2Device(V4l2Device&& other) noexcept;
  V4l2Device& operator=(V4l2Device&& other) noexcept;

  const std::filesystem::path& node() const { return node_; }
  int descriptor() const { return descriptor_; }

  /// ioctl(), repeated while signals interrupt it. Returns 0 or errno.
  int try_call(unsigned long request, void* argument) const;
  /// The same; throws DeviceError, `what` says what was to be done.
  void call(unsigned long request, void* argument, const std::string& what) const;
  /// The DeviceError of a failed call.
  [[noreturn]] void fail(int error_number, const std::string& what) const;

 private:
  std::filesystem::path node_;
  int descriptor_ = -1;
};

/// What a camera is called: `bus` and `card` stay the same when it is unplugged and plugged in again; the
/// node's number may change.
struct V4l2Identity {
  std::filesystem::path node;  ///< /dev/video0
  std::string card;            ///< "HD Pro Webcam C920"
  std::string bus;             ///< "usb-0000:00:14.0-1"
  std::string driver;
};

struct V4l2FrameSize {
  int width = 0;
  int height = 0;
  std::vector<double> rates;  ///< frames per second, highest first; empty where the driver does not say
};

struct V4l2FormatInfo {
  std::uint32_t fourcc = 0;
  std::string name;                  ///< as the driver describes it
  std::vector<V4l2FrameSize> sizes;  ///< of a range: its smallest and largest
};

struct V4l2ControlInfo {
  std::uint32_t id = 0;
  std::string name;  ///< as v4l2-ctl spells it: "exposure_time_absolute"
  std::int64_t lowest = 0, highest = 0, step = 0, standard = 0, value = 0;
  std::vector<std::string> menu;  ///< choices; empty for numbers
  bool is_writable = false;
};

/// nullopt when the node does not stream captured video by memory mapping (outputs, metadata, radio).
std::optional<V4l2Identity> capture_identity(const V4l2Device& device);
std::vector<V4l2FormatInfo> formats_of(const V4l2Device& device);
std::vector<V4l2ControlInfo> controls_of(const V4l2Device& device);

/// Cameras of this machine in order of their nodes. Nodes that may not be opened are left out.
std::vector<V4l2Identity> find_v4l2_cameras();

/// The camera that `text` names: a node (/dev/video0, a link of /dev/v4l/by-id), a bus or a card name. Throws
/// InputError when none or several answer to it; the message lists those that are there.
V4l2Identity find_v4l2_camera(const std::string& text);

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
