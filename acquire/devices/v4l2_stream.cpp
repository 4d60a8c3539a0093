// SPDX-License-Identifier: Apache-2.0
#include "acquire/devices/v4l2_stream.h"

#include <linux/videodev2.h>
#include <poll.h>
#include <sys/mman.h>

#include <algorithm>
#include <cerrno>
#include <cmath>

#include "acquire/devices/pixel_formats.h"
#include "core/base/errors.h"
#include "core/base/run_context.h"

namespace refield {

namespace {

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
