// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstddef>
#include <span>
#include <string>
#include <vector>

namespace refield {

/// A float image: row-major, top row first, channels interleaved, scene-linear. Pixel centres lie at +0.5.
struct Image {
  int width = 0;
  int height = 0;
  int channels = 0;
  std::vector<float> values;

  Image() = default;
  Image(int width_px, int height_px, int channel_count, float fill = 0.0f)
      : width(width_px),
        height(height_px),
        channels(channel_count),
        values(static_cast<std::size_t>(width_px) * height_px * channel_count, fill) {}

  std::size_t pixel_count() const { return static_cast<std::size_t>(width) * height; }
  bool empty() const { return values.empty(); }
  bool same_shape(const Image& other) const {
    return width == other.width && height == other.height && channels == other.channels;
  }
  float& at(int x, int y, int c) { return values[index(x, y, c)]; }
  float at(int x, int y, int c) const { return values[index(x, y, c)]; }
  /// One row, [width × channels] values.
  std::span<float> row(int y) { return {values.data() + index(0, y, 0), row_size()}; }
  std::span<const float> row(int y) const { return {values.data() + index(0, y, 0), row_size()}; }

 private:
  std::size_t row_size() const { return static_cast<std::size_t>(width) * channels; }
  std::size_t index(int x, int y, int c) const {
    return (static_cast<std::size_t>(y) * width + x) * channels + c;
  }
};

/// "640×480×3", for messages.
std::string shape_text(const Image& image);

/// Throws InputError, naming `name` and the first bad pixel, when a value is NaN, infinite or, unless
/// `allow_negative`, below zero. `remedy` ends the message.
void require_finite(const Image& image, const std::string& name, bool allow_negative,
                    const std::string& remedy);

}  // namespace refield
