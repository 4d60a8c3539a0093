// SPDX-License-Identifier: Apache-2.0
#include "acquire/devices/v4l2_device.h"

#include <fcntl.h>
#include <linux/videodev2.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <functional>
#include <utility>

#include "acquire/devices/pixel_formats.h"

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

constexpr auto capture_type = static_cast<__u32>(V4L2_BUF_TYPE_VIDEO_CAPTURE);
constexpr int max_stop_checks_ms = 200;  // how soon Ctrl-C is heard while no frame comes

v4l2_buffer mapped_buffer(std::uint32_t index) {
  v4l2_buffer buffer{};
  buffer.type = capture_type;
  buffer.memory = V4L2_MEMORY_MMAP;
  buffer.index = index;
  return buffer;
}

std::string size_text(int width, int height) {
  return std::to_string(width) + "×" + std::to_string(height);
}

bool is_bt709(const v4l2_pix_format& pixels) {
  if (pixels.ycbcr_enc != V4L2_YCBCR_ENC_DEFAULT) return pixels.ycbcr_enc == V4L2_YCBCR_ENC_709;
  return V4L2_MAP_YCBCR_ENC_DEFAULT(pixels.colorspace) == V4L2_YCBCR_ENC_709;
}

bool is_full_range(const v4l2_pix_format& pixels) {
  if (pixels.quantization != V4L2_QUANTIZATION_DEFAULT)
    return pixels.quantization == V4L2_QUANTIZATION_FULL_RANGE;
  return pixels.colorspace == V4L2_COLORSPACE_JPEG;
}

/// Frame interval of an input that follows its source's timings, such as HDMI; 0 where it does not.
Seconds interval_of_timings(const V4l2Device& device) {
  v4l2_dv_timings timings{};
  if (device.try_call(VIDIOC_G_DV_TIMINGS, &timings) != 0 || timings.bt.pixelclock == 0) return Seconds(0);
  const double total =
      static_cast<double>(V4L2_DV_BT_FRAME_WIDTH(&timings.bt)) * V4L2_DV_BT_FRAME_HEIGHT(&timings.bt);
  return Seconds(total / static_cast<double>(timings.bt.pixelclock));
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

// What a V4L2 camera offers: formats, sizes, rates, controls.

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

V4l2Stream::V4l2Stream(const V4l2Device& device, const V4l2StreamRequest& request, RunContext run)
    : device_(device), run_(std::move(run)) {
  choose_format(request);
  choose_rate(request.rate);
  try {
    map_buffers(request.buffers);
    start();
  } catch (...) {
    unmap_buffers();
    throw;
  }
}

V4l2Stream::~V4l2Stream() {
  auto type = capture_type;
  device_.try_call(VIDIOC_STREAMOFF, &type);
  unmap_buffers();
}

void V4l2Stream::choose_format(const V4l2StreamRequest& request) {
  v4l2_format format{};
  format.type = capture_type;
  device_.call(VIDIOC_G_FMT, &format, "does not report its format");
  v4l2_pix_format& pixels = format.fmt.pix;
  if (request.fourcc != 0) pixels.pixelformat = request.fourcc;
  if (request.width > 0) pixels.width = static_cast<__u32>(request.width);
  if (request.height > 0) pixels.height = static_cast<__u32>(request.height);
  pixels.field = V4L2_FIELD_NONE;
  pixels.bytesperline = 0;
  device_.call(VIDIOC_S_FMT, &format,
               "refuses the format " + fourcc_text(pixels.pixelformat) + " " +
                   size_text(request.width, request.height));
  format_ = {pixels.pixelformat,
             static_cast<int>(pixels.width),
             static_cast<int>(pixels.height),
             pixels.bytesperline,
             is_bt709(pixels),
             is_full_range(pixels),
             Seconds(0)};
  const std::string remedy = "; 'refield acquire devices' lists formats and sizes";
  if (request.fourcc != 0 && pixels.pixelformat != request.fourcc)
    throw InputError(device_.node().string() + ": gives " + fourcc_text(pixels.pixelformat) +
                     " in place of " + fourcc_text(request.fourcc) + remedy);
  if ((request.width > 0 && format_.width != request.width) ||
      (request.height > 0 && format_.height != request.height))
    throw InputError(device_.node().string() + ": gives " + size_text(format_.width, format_.height) +
                     " pixels in place of " + size_text(request.width, request.height) + remedy);
  if (pixels.field != V4L2_FIELD_NONE)
    throw InputError(device_.node().string() + ": sends interlaced fields; choose a progressive mode");
}

void V4l2Stream::choose_rate(double rate) {
  v4l2_streamparm parameters{};
  parameters.type = capture_type;
  v4l2_fract& interval = parameters.parm.capture.timeperframe;
  const bool tells = device_.try_call(VIDIOC_G_PARM, &parameters) == 0;
  if (rate > 0.0) {
    interval = {1000, static_cast<__u32>(std::lround(1000.0 * rate))};
    device_.call(VIDIOC_S_PARM, &parameters, "refuses a frame rate of " + std::to_string(rate) + " Hz");
    const double made = static_cast<double>(interval.denominator) / std::max<__u32>(interval.numerator, 1);
    if (std::abs(made - rate) > 0.02 * rate)
      throw InputError(device_.node().string() + ": runs at " + std::to_string(made) + " Hz in place of " +
                       std::to_string(rate) + "; 'refield acquire devices' lists rates");
  }
  if (tells && interval.denominator > 0)
    format_.frame_interval = Seconds(static_cast<double>(interval.numerator) / interval.denominator);
  if (const Seconds source = interval_of_timings(device_); source.count() > 0.0 && rate <= 0.0)
    format_.frame_interval = source;
}

void V4l2Stream::map_buffers(int count) {
  v4l2_requestbuffers request{};
  request.type = capture_type;
  request.memory = V4L2_MEMORY_MMAP;
  request.count = static_cast<__u32>(count);
  device_.call(VIDIOC_REQBUFS, &request, "refuses memory-mapped buffers");
  for (__u32 i = 0; i < request.count; ++i) {
    v4l2_buffer buffer = mapped_buffer(i);
    device_.call(VIDIOC_QUERYBUF, &buffer, "does not show buffer " + std::to_string(i));
    void* memory = ::mmap(nullptr, buffer.length, PROT_READ | PROT_WRITE, MAP_SHARED, device_.descriptor(),
                          buffer.m.offset);
    if (memory == MAP_FAILED) device_.fail(errno, "cannot map buffer " + std::to_string(i));
    buffers_.emplace_back(static_cast<std::uint8_t*>(memory), buffer.length);
  }
}

void V4l2Stream::unmap_buffers() noexcept {
  for (const auto& buffer : buffers_) ::munmap(buffer.data(), buffer.size());
  buffers_.clear();
  v4l2_requestbuffers none{};
  none.type = capture_type;
  none.memory = V4L2_MEMORY_MMAP;
  device_.try_call(VIDIOC_REQBUFS, &none);
}

void V4l2Stream::start() {
  for (std::uint32_t i = 0; i < buffers_.size(); ++i) {
    v4l2_buffer buffer = mapped_buffer(i);
    device_.call(VIDIOC_QBUF, &buffer, "does not take buffer " + std::to_string(i));
  }
  auto type = capture_type;
  device_.call(VIDIOC_STREAMON, &type, "does not start streaming");
}

void V4l2Stream::restart() {
  auto type = capture_type;
  device_.call(VIDIOC_STREAMOFF, &type, "does not stop streaming");
  start();
}

bool V4l2Stream::wait_until_filled(Seconds timeout) const {
  const auto deadline = std::chrono::steady_clock::now() + timeout;
  while (true) {
    run_.throw_if_stopped();
    const auto left =
        std::chrono::ceil<std::chrono::milliseconds>(deadline - std::chrono::steady_clock::now());
    pollfd waiting{device_.descriptor(), POLLIN, 0};
    const int wait_ms = static_cast<int>(std::clamp<std::int64_t>(left.count(), 0, max_stop_checks_ms));
    const int ready = ::poll(&waiting, 1, wait_ms);
    if (ready < 0 && errno != EINTR) device_.fail(errno, "cannot be waited for");
    // POLLERR and POLLHUP, too: VIDIOC_DQBUF tells what is wrong.
    if (ready > 0) return true;
    // Looked at least once: after a pause of the whole program a frame may be there.
    if (left.count() <= 0) return false;
  }
}

std::optional<V4l2Filled> V4l2Stream::take(Seconds timeout) {
  if (!wait_until_filled(timeout)) return std::nullopt;
  v4l2_buffer buffer = mapped_buffer(0);
  const int error = device_.try_call(VIDIOC_DQBUF, &buffer);
  if (error == EAGAIN) return std::nullopt;
  if (error == EIO || error == EINVAL || error == EPIPE) device_.fail(EIO, "stopped streaming");
  if (error != 0) device_.fail(error, "gives no frame");
  const auto used = std::min<std::size_t>(buffer.bytesused, buffers_.at(buffer.index).size());
  const auto stamp =
      std::chrono::seconds(buffer.timestamp.tv_sec) + std::chrono::microseconds(buffer.timestamp.tv_usec);
  return V4l2Filled{buffer.index,
                    std::span<const std::uint8_t>(buffers_[buffer.index]).first(used),
                    TimePoint(stamp),
                    (buffer.flags & V4L2_BUF_FLAG_TSTAMP_SRC_MASK) == V4L2_BUF_FLAG_TSTAMP_SRC_EOF,
                    (buffer.flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) == V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC,
                    (buffer.flags & V4L2_BUF_FLAG_ERROR) != 0,
                    buffer.sequence};
}

void V4l2Stream::give_back(const V4l2Filled& filled) {
  v4l2_buffer buffer = mapped_buffer(filled.index);
  const int error = device_.try_call(VIDIOC_QBUF, &buffer);
  if (error != 0) device_.fail(error == ENODEV ? ENODEV : EIO, "does not take a buffer back");
}

bool V4l2Stream::has_signal() const {
  v4l2_input input{};
  int index = 0;
  if (device_.try_call(VIDIOC_G_INPUT, &index) != 0) return true;
  input.index = static_cast<__u32>(index);
  if (device_.try_call(VIDIOC_ENUMINPUT, &input) != 0) return true;
  return (input.status & (V4L2_IN_ST_NO_POWER | V4L2_IN_ST_NO_SIGNAL | V4L2_IN_ST_NO_SYNC)) == 0;
}

}  // namespace refield
