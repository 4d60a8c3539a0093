// SPDX-License-Identifier: Apache-2.0
#include "tests/devices/video_output.h"

#include <linux/videodev2.h>
#include <poll.h>
#include <sys/mman.h>

#include <algorithm>
#include <cerrno>

namespace refield::test {

namespace {

constexpr auto output_type = static_cast<__u32>(V4L2_BUF_TYPE_VIDEO_OUTPUT);

v4l2_buffer mapped_buffer(std::uint32_t index) {
  v4l2_buffer buffer{};
  buffer.type = output_type;
  buffer.memory = V4L2_MEMORY_MMAP;
  buffer.index = index;
  return buffer;
}

}  // namespace

VideoOutput::VideoOutput(const std::string& node, std::uint32_t fourcc, int width, int height)
    : device_(node), width_(width) {
  v4l2_format format{};
  format.type = output_type;
  device_.call(VIDIOC_G_FMT, &format, "tells no format");
  format.fmt.pix.pixelformat = fourcc;
  format.fmt.pix.width = static_cast<__u32>(width);
  format.fmt.pix.height = static_cast<__u32>(height);
  format.fmt.pix.bytesperline = 0;
  device_.call(VIDIOC_S_FMT, &format, "refuses the format");
  if (format.fmt.pix.pixelformat != fourcc ||
      format.fmt.pix.bytesperline != 2u * static_cast<unsigned>(width))
    device_.fail(EINVAL, "chose another format");
  v4l2_requestbuffers request{};
  request.type = output_type;
  request.memory = V4L2_MEMORY_MMAP;
  request.count = 8;
  device_.call(VIDIOC_REQBUFS, &request, "refuses buffers");
  for (__u32 i = 0; i < request.count; ++i) {
    v4l2_buffer buffer = mapped_buffer(i);
    device_.call(VIDIOC_QUERYBUF, &buffer, "shows no buffer");
    void* memory = ::mmap(nullptr, buffer.length, PROT_READ | PROT_WRITE, MAP_SHARED, device_.descriptor(),
                          buffer.m.offset);
    if (memory == MAP_FAILED) device_.fail(errno, "maps no buffer");
    buffers_.emplace_back(static_cast<std::uint16_t*>(memory), buffer.length / 2);
    std::ranges::fill(buffers_.back(), std::uint16_t{0});
    free_.push_back(i);
  }
  auto type = output_type;
  device_.call(VIDIOC_STREAMON, &type, "does not stream");
}

VideoOutput::~VideoOutput() {
  for (const auto& buffer : buffers_) ::munmap(buffer.data(), buffer.size_bytes());
}

std::uint32_t VideoOutput::free_buffer() {
  while (true) {
    v4l2_buffer done = mapped_buffer(0);
    if (device_.try_call(VIDIOC_DQBUF, &done) == 0) {
      free_.push_back(done.index);
      continue;
    }
    if (!free_.empty()) break;
    pollfd waiting{device_.descriptor(), POLLOUT, 0};
    ::poll(&waiting, 1, 100);
  }
  const std::uint32_t index = free_.front();
  free_.erase(free_.begin());
  return index;
}

void VideoOutput::send(std::span<const std::uint16_t> samples, int columns, TimePoint stamp) {
  v4l2_buffer buffer = mapped_buffer(free_buffer());
  std::uint16_t* memory = buffers_[buffer.index].data();
  for (std::size_t row = 0; row * columns < samples.size(); ++row)
    std::copy_n(samples.data() + row * columns, columns, memory + row * width_);
  buffer.bytesused = static_cast<__u32>(buffers_[buffer.index].size_bytes());
  buffer.field = V4L2_FIELD_NONE;
  const auto microseconds = std::chrono::floor<std::chrono::microseconds>(stamp.time_since_epoch()).count();
  buffer.timestamp.tv_sec = microseconds / 1'000'000;
  buffer.timestamp.tv_usec = microseconds % 1'000'000;
  device_.call(VIDIOC_QBUF, &buffer, "takes no frame");
}

}  // namespace refield::test
