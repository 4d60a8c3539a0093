// SPDX-License-Identifier: Apache-2.0
#include "acquire/v4l2_device.h"

#include <fcntl.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include "core/errors.h"

namespace refield {

namespace fs = std::filesystem;

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
  throw DeviceError(node_.string(), error_number, what + remedy);
}

std::optional<V4l2Identity> capture_identity(const V4l2Device& device) {
  v4l2_capability capability{};
  if (device.try_call(VIDIOC_QUERYCAP, &capability) != 0) return std::nullopt;
  const auto able =
      capability.capabilities & V4L2_CAP_DEVICE_CAPS ? capability.device_caps : capability.capabilities;
  if (!(able & V4L2_CAP_VIDEO_CAPTURE) || !(able & V4L2_CAP_STREAMING)) return std::nullopt;
  return V4l2Identity{device.node(), text_of(capability.card), text_of(capability.bus_info),
                      text_of(capability.driver)};
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
    throw InputError(text + ": is no camera that streams by memory mapping; " + list_of(cameras));
  }
  throw InputError("camera '" + text +
                   "': " + (found.empty() ? "no device has this name" : "several devices have this name") +
                   "; " + list_of(cameras));
}

}  // namespace refield
