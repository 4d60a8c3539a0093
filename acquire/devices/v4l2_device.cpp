// SPDX-License-Identifier: Apache-2.0
#include "acquire/devices/v4l2_device.h"

#include <fcntl.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstring>
#include <utility>

namespace refield {

namespace {

std::string text_of(const __u8* text) {
  return reinterpret_cast<const char*>(text);
}

/// Number of /dev/videoN, for a natural order.
int number_of(const fs::path& node) {
  const std::string name = node.filename();
  return std::atoi(name.c_str() + std::strlen("video"));
}

std::string list_of(const std::vector<V4l2Identity>& cameras) {
  if (cameras.empty())
    return "no camera was found; check that it is connected and that you may read /dev/video* (group video)";
  std::string text = "there are";
  for (const V4l2Identity& camera : cameras)
    text += " " + camera.node.string() + " (" + camera.card + ", " + camera.bus + ")";
  return text;
}

double rate_of(const v4l2_fract& interval) {
  return interval.numerator ? static_cast<double>(interval.denominator) / interval.numerator : 0.0;
}

std::vector<double> rates_of(const V4l2Device& device, std::uint32_t fourcc, int width, int height) {
  std::vector<double> rates;
  v4l2_frmivalenum entry{};
  entry.pixel_format = fourcc;
  entry.width = static_cast<__u32>(width);
  entry.height = static_cast<__u32>(height);
  for (; device.try_call(VIDIOC_ENUM_FRAMEINTERVALS, &entry) == 0; ++entry.index) {
    if (entry.type == V4L2_FRMIVAL_TYPE_DISCRETE) {
      rates.push_back(rate_of(entry.discrete));
      continue;
    }
    rates = {rate_of(entry.stepwise.min), rate_of(entry.stepwise.max)};
    break;
  }
  std::ranges::sort(rates, std::greater<>());
  return rates;
}

std::vector<V4l2FrameSize> sizes_of(const V4l2Device& device, std::uint32_t fourcc) {
  std::vector<V4l2FrameSize> sizes;
  const auto add = [&](__u32 width, __u32 height) {
    const auto w = static_cast<int>(width);
    const auto h = static_cast<int>(height);
    sizes.push_back({w, h, rates_of(device, fourcc, w, h)});
  };
  v4l2_frmsizeenum entry{};
  entry.pixel_format = fourcc;
  for (; device.try_call(VIDIOC_ENUM_FRAMESIZES, &entry) == 0; ++entry.index) {
    if (entry.type == V4L2_FRMSIZE_TYPE_DISCRETE) {
      add(entry.discrete.width, entry.discrete.height);
      continue;
    }
    add(entry.stepwise.min_width, entry.stepwise.min_height);
    add(entry.stepwise.max_width, entry.stepwise.max_height);
    break;
  }
  return sizes;
}

/// "Exposure Time, Absolute" as "exposure_time_absolute".
std::string control_name(const char* text) {
  std::string name;
  for (; *text; ++text) {
    if (std::isalnum(static_cast<unsigned char>(*text)))
      name += static_cast<char>(std::tolower(static_cast<unsigned char>(*text)));
    else if (!name.empty() && name.back() != '_')
      name += '_';
  }
  if (name.ends_with('_')) name.pop_back();
  return name;
}

std::vector<std::string> menu_of(const V4l2Device& device, const v4l2_query_ext_ctrl& control) {
  std::vector<std::string> menu;
  if (control.type != V4L2_CTRL_TYPE_MENU && control.type != V4L2_CTRL_TYPE_INTEGER_MENU) return menu;
  for (std::int64_t i = control.minimum; i <= control.maximum; ++i) {
    v4l2_querymenu entry{};
    entry.id = control.id;
    entry.index = static_cast<__u32>(i);
    if (device.try_call(VIDIOC_QUERYMENU, &entry) != 0) continue;
    menu.push_back(std::to_string(i) + "=" +
                   (control.type == V4L2_CTRL_TYPE_MENU ? reinterpret_cast<const char*>(entry.name)
                                                        : std::to_string(entry.value)));
  }
  return menu;
}

/// nullopt when the node does not stream captured video by memory mapping (outputs, metadata, radio).
std::optional<V4l2Identity> capture_identity(const V4l2Device& device) {
  v4l2_capability capability{};
  if (device.try_call(VIDIOC_QUERYCAP, &capability) != 0) return std::nullopt;
  const auto able =
      capability.capabilities & V4L2_CAP_DEVICE_CAPS ? capability.device_caps : capability.capabilities;
  if (!(able & V4L2_CAP_VIDEO_CAPTURE) || !(able & V4L2_CAP_STREAMING)) return std::nullopt;
  return V4l2Identity{device.node(), text_of(capability.card), text_of(capability.bus_info),
                      text_of(capability.driver)};
}

}  // namespace

V4l2Device::V4l2Device(const fs::path& node)
    : node_(node), descriptor_(::open(node.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC)) {
  if (descriptor_ < 0) fail(errno, "cannot be opened");
}

V4l2Device::~V4l2Device() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

V4l2Device::V4l2Device(V4l2Device&& other) noexcept
    : node_(std::move(other.node_)), descriptor_(std::exchange(other.descriptor_, -1)) {}

V4l2Device& V4l2Device::operator=(V4l2Device&& other) noexcept {
  std::swap(node_, other.node_);
  std::swap(descriptor_, other.descriptor_);
  return *this;
}

int V4l2Device::try_call(unsigned long request, void* argument) const {
  int status = 0;
  do status = ::ioctl(descriptor_, request, argument);
  while (status < 0 && errno == EINTR);
  return status < 0 ? errno : 0;
}

void V4l2Device::call(unsigned long request, void* argument, const std::string& what) const {
  if (const int error = try_call(request, argument)) fail(error, what);
}

void V4l2Device::fail(int error_number, const std::string& what) const {
  std::string remedy;
  if (error_number == ENODEV || error_number == ENXIO)
    remedy = "; the camera was unplugged: plug it in again and resume";
  else if (error_number == EBUSY)
    remedy = "; another program uses the camera: close it";
  else if (error_number == EACCES || error_number == EPERM)
    remedy = "; permission denied: become a member of the group video";
  else if (error_number == ENOLINK || error_number == ENOLCK)
    remedy = "; no signal arrives at the input: check cable and source";
  else if (error_number == ENOENT)
    remedy = "; 'refield acquire devices' lists what is there";
  throw DeviceError(node_.string(), error_number, what, remedy);
}

std::vector<V4l2Identity> find_v4l2_cameras() {
  std::vector<fs::path> nodes;
  std::error_code none;
  for (const fs::directory_entry& entry : fs::directory_iterator("/dev", none))
    if (entry.path().filename().string().starts_with("video")) nodes.push_back(entry.path());
  std::ranges::sort(nodes, {}, number_of);
  std::vector<V4l2Identity> cameras;
  for (const fs::path& node : nodes) try {
      if (auto identity = capture_identity(V4l2Device(node))) cameras.push_back(std::move(*identity));
    } catch (const DeviceError&) {  // not ours to open
    }
  return cameras;
}

V4l2Identity find_v4l2_camera(const std::string& text) {
  std::error_code none;
  const fs::path node = fs::weakly_canonical(text, none);
  const auto cameras = find_v4l2_cameras();
  std::vector<V4l2Identity> found;
  for (const V4l2Identity& camera : cameras)
    if (camera.node == node || camera.bus == text || camera.card == text) found.push_back(camera);
  // A camera may have several nodes; without more to go by the first one is meant.
  const bool one_bus = !found.empty() && std::ranges::all_of(found, [&](const V4l2Identity& camera) {
    return camera.bus == found.front().bus;
  });
  if (one_bus) return found.front();
  if (found.empty() && fs::exists(node)) {
    const V4l2Device device(node);  // says why it cannot be opened
    throw InputError(text, ": is no camera that streams by memory mapping; ", list_of(cameras));
  }
  throw InputError("camera '", text,
                   "': ", found.empty() ? "no device has this name" : "several devices have this name", "; ",
                   list_of(cameras));
}

std::vector<V4l2FormatInfo> formats_of(const V4l2Device& device) {
  std::vector<V4l2FormatInfo> formats;
  v4l2_fmtdesc entry{};
  entry.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  for (; device.try_call(VIDIOC_ENUM_FMT, &entry) == 0; ++entry.index)
    formats.push_back({entry.pixelformat, reinterpret_cast<const char*>(entry.description),
                       sizes_of(device, entry.pixelformat)});
  return formats;
}

std::vector<V4l2ControlInfo> controls_of(const V4l2Device& device) {
  std::vector<V4l2ControlInfo> controls;
  v4l2_query_ext_ctrl control{};
  control.id = V4L2_CTRL_FLAG_NEXT_CTRL;
  for (; device.try_call(VIDIOC_QUERY_EXT_CTRL, &control) == 0; control.id |= V4L2_CTRL_FLAG_NEXT_CTRL) {
    const bool is_number = control.type == V4L2_CTRL_TYPE_INTEGER || control.type == V4L2_CTRL_TYPE_BOOLEAN ||
                           control.type == V4L2_CTRL_TYPE_MENU || control.type == V4L2_CTRL_TYPE_INTEGER_MENU;
    if (!is_number || control.flags & V4L2_CTRL_FLAG_DISABLED) continue;
    v4l2_control current{control.id, 0};
    if (device.try_call(VIDIOC_G_CTRL, &current) != 0) continue;
    controls.push_back({control.id, control_name(control.name), control.minimum, control.maximum,
                        static_cast<std::int64_t>(control.step), control.default_value, current.value,
                        menu_of(device, control), !(control.flags & V4L2_CTRL_FLAG_READ_ONLY)});
  }
  return controls;
}

}  // namespace refield
