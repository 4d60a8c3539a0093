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

/// A float image that another user owns and keeps while the view is used: scene-linear, top row first.
/// Strides count floats and may be negative (an image stored bottom row first).
struct ImageView {
  const float* values = nullptr;  ///< first channel of the top left pixel
  int width = 0;
  int height = 0;
  int channels = 0;
  std::ptrdiff_t channel_stride = 1;
  std::ptrdiff_t pixel_stride = 0;
  std::ptrdiff_t row_stride = 0;

  ImageView() = default;
  /// Channels interleaved, pixels and rows without gaps.
  ImageView(const float* first, int width_px, int height_px, int channel_count)
      : ImageView(first, width_px, height_px, channel_count, 1, channel_count,
                  static_cast<std::ptrdiff_t>(width_px) * channel_count) {}
  ImageView(const float* first, int width_px, int height_px, int channel_count, std::ptrdiff_t channel_floats,
            std::ptrdiff_t pixel_floats, std::ptrdiff_t row_floats)
      : values(first),
        width(width_px),
        height(height_px),
        channels(channel_count),
        channel_stride(channel_floats),
        pixel_stride(pixel_floats),
        row_stride(row_floats) {}
  ImageView(const Image& image)  // NOLINT(google-explicit-constructor): wherever a view is taken
      : ImageView(image.values.data(), image.width, image.height, image.channels) {}

  bool empty() const { return width == 0 || height == 0 || channels == 0; }
  float at(int x, int y, int c) const {
    return values[y * row_stride + x * pixel_stride + c * channel_stride];
  }
};

/// The rows [first, last) of a view as an image.
Image copied_rows(const ImageView& view, int first, int last);

/// "640×480×3", for messages.
std::string shape_text(const Image& image);

/// Throws InputError, naming `name` and the first bad pixel, when a value is NaN, infinite or, unless
/// `allow_negative`, below zero. `remedy` ends the message.
void require_finite(const Image& image, const std::string& name, bool allow_negative,
                    const std::string& remedy);

/// An image at another size: each new texel is the mean of the radiance over its area of the old image, to
/// the fraction of a texel. Light is neither lost nor made (the mean over the image stays what it was),
/// nothing overshoots, and enlarging repeats texels, with a mixed one where a border falls within. Each side
/// is scaled on its own. Throws InputError for an empty image or a size below 1.
Image resample_area(const Image& image, int width, int height);

/// The same without changing the shape of what it shows: the middle part of `image` with the proportions of
/// width:height, then resample_area().
Image resample_area_cropped(const Image& image, int width, int height);

}  // namespace refield
