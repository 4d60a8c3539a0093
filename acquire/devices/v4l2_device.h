// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/units.h"

namespace refield {

/// An open V4L2 node. Every call names the device in its errors, and says so in clear words when the device
/// was unplugged.
class V4l2Device {
 public:
  /// Throws DeviceError when the node is missing, busy or may not be opened.
  explicit V4l2Device(const fs::path& node);
  ~V4l2Device();
  V4l2Device(V4l2Device&& other) noexcept;
  V4l2Device& operator=(V4l2Device&& other) noexcept;

  const fs::path& node() const { return node_; }
  int descriptor() const { return descriptor_; }

  /// ioctl(), repeated while signals interrupt it. Returns 0 or errno.
  int try_call(unsigned long request, void* argument) const;
  /// The same; throws DeviceError, `what` says what was to be done.
  void call(unsigned long request, void* argument, const std::string& what) const;
  /// The DeviceError of a failed call.
  [[noreturn]] void fail(int error_number, const std::string& what) const;

 private:
  fs::path node_;
  int descriptor_ = -1;
};

/// What a camera is called: `bus` and `card` stay the same when it is unplugged and plugged in again; the
/// node's number may change.
struct V4l2Identity {
  fs::path node;     ///< /dev/video0
  std::string card;  ///< "HD Pro Webcam C920"
  std::string bus;   ///< "usb-0000:00:14.0-1"
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

std::vector<V4l2FormatInfo> formats_of(const V4l2Device& device);
std::vector<V4l2ControlInfo> controls_of(const V4l2Device& device);

/// Cameras of this machine in order of their nodes. Nodes that may not be opened are left out.
std::vector<V4l2Identity> find_v4l2_cameras();

/// The camera that `text` names: a node (/dev/video0, a link of /dev/v4l/by-id), a bus or a card name. Throws
/// InputError when none or several answer to it; the message lists those that are there.
V4l2Identity find_v4l2_camera(const std::string& text);

}  // namespace refield
