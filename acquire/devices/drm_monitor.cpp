// SPDX-License-Identifier: Apache-2.0
#include "acquire/devices/drm_monitor.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <thread>

#include "acquire/devices/drm_device.h"
#include "core/base/errors.h"

namespace refield {

/// A monitor is dark while it follows a new mode: one to two seconds on HDMI and DisplayPort.
constexpr Seconds mode_change{2.0};

struct DrmMonitor::State {
  DrmConnectorInfo connector;
  std::size_t mode;
  int width, height;  // of light maps
  int scale;
  DrmDevice device;
  std::array<DrmBuffer, 2> buffers;
  std::size_t back = 1;

  explicit State(const DrmMonitorOptions& options)
      : connector(find_drm_connector(options.card, options.connector)),
        mode(find_drm_mode(connector, options.mode)),
        width(options.width > 0 ? options.width : screen().width),
        height(options.height > 0 ? options.height : screen().height),
        scale(largest_scale()),
        device(connector, mode) {
    for (DrmBuffer& buffer : buffers) {
      buffer = device.make_buffer(screen().width, screen().height);
      std::ranges::fill(buffer.bytes, std::uint8_t{0});
    }
    device.light_up(buffers[0]);
    std::this_thread::sleep_for(mode_change);
  }

  const DrmModeInfo& screen() const { return connector.modes[mode]; }

  int largest_scale() const {
    const int result = std::min(screen().width / width, screen().height / height);
    if (result >= 1) return result;
    throw InputError(connector.name + ": light maps of " + std::to_string(width) + "×" +
                     std::to_string(height) + " texels are larger than its mode " + screen().text());
  }

  /// Writes the pattern's lines into the middle of a buffer.
  void draw(const DriveImage& image, const DrmBuffer& buffer) const {
    const std::size_t left = static_cast<std::size_t>(screen().width - width * scale) / 2;
    const std::size_t top = static_cast<std::size_t>(screen().height - height * scale) / 2;
    const std::size_t line_bytes = std::size_t{4} * width * scale;
    for (int y = 0; y < height; ++y) {
      const std::uint8_t* levels = image.levels.data() + std::size_t{3} * width * y;
      std::uint8_t* first = buffer.bytes.data() +
                            (top + static_cast<std::size_t>(y) * scale) * buffer.bytes_per_line + 4 * left;
      std::uint8_t* out = first;
      for (int x = 0; x < width; ++x, levels += 3)
        for (int i = 0; i < scale; ++i, out += 4) {  // XRGB in little-endian words
          out[0] = levels[2];
          out[1] = levels[1];
          out[2] = levels[0];
        }
      for (int i = 1; i < scale; ++i) std::memcpy(first + i * buffer.bytes_per_line, first, line_bytes);
    }
  }
};

DrmMonitor::DrmMonitor(const DrmMonitorOptions& options) : state_(std::make_unique<State>(options)) {}
DrmMonitor::~DrmMonitor() = default;

IlluminatorDescription DrmMonitor::describe() const {
  return {state_->connector.name + " (" + state_->connector.driver + ") " + state_->screen().text(),
          state_->width, state_->height, Seconds(0), Seconds(0)};
}

int DrmMonitor::pixels_per_texel() const {
  return state_->scale;
}

TimePoint DrmMonitor::show(const DriveImage& image) {
  State& state = *state_;
  require_size(image, state.width, state.height, state.connector.name);
  state.device.require_monitor();
  state.draw(image, state.buffers[state.back]);
  const TimePoint flipped = state.device.flip(state.buffers[state.back]);
  state.device.require_monitor();
  state.back = 1 - state.back;
  return flipped;
}

}  // namespace refield
