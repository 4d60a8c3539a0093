// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "acquire/devices/v4l2_device.h"
#include "core/base/units.h"

namespace refield::test {

/// vivid's output node, whose frames its camera then shows: 16-bit samples with the time stamp of their
/// exposure.
class VideoOutput {
 public:
  VideoOutput(const std::string& node, std::uint32_t fourcc, int width, int height);
  ~VideoOutput();
  /// Sends a frame that is black but for the window of `samples` [rows × columns] in its top left corner.
  void send(std::span<const std::uint16_t> samples, int columns, TimePoint stamp);

 private:
  std::uint32_t free_buffer();
  V4l2Device device_;
  int width_;
  std::vector<std::span<std::uint16_t>> buffers_;
  std::vector<std::uint32_t> free_;
};

}  // namespace refield::test
