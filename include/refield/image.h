// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstddef>
#include <filesystem>
#include <span>
#include <string_view>
#include <vector>

#include "refield/run_context.h"

/// Images: row-major, top row first, float, scene-linear RGB; pixel centres lie at +0.5. Radiance is relative
/// unless a calibration gives absolute units.
namespace refield {
inline namespace v0_2 {

struct ImageView;

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

  /// A copy.
  explicit Image(const ImageView& view);

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

inline Image::Image(const ImageView& view) : Image(view.width, view.height, view.channels) {
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int c = 0; c < channels; ++c) at(x, y, c) = view.at(x, y, c);
}

/// Which pixels count: [pixels], non-zero where the scene is of interest. Empty: all.
using Mask = std::vector<unsigned char>;

/// Rows [first, last) of an image, counted from the top.
struct RowRange {
  int first = 0;
  int last = 0;

  int count() const { return last - first; }
  bool operator==(const RowRange&) const = default;
};

/// A photograph, or a band of its rows: scene-linear radiance and, where known, each sample's standard
/// deviation. In EXR files the channels are R, G, B and sigma.R, sigma.G, sigma.B. An infinite sigma marks a
/// sample that was not measured (clipped in every exposure); its radiance is then only a lower bound.
struct Photograph {
  Image radiance;  ///< [rows × width × 3]
  Image sigma;     ///< same shape, or empty
};

/// How far an image is from another: relative RMSE, unitless, and the PSNR of both as a screen shows them.
struct ImageError {
  double relative_rmse = 0.0;
  double tone_mapped_psnr_db = 0.0;
};

/// What the three channels of photographs and fields mean.
///  - camera: the camera's own channels; nothing says how they see colours.
///  - rec709: scene-linear light of the primaries of Rec. ITU-R BT.709 and sRGB, white D65.
enum class ColourSpace { camera, rec709 };

/// "camera RGB", "linear Rec.709".
REFIELD_API std::string_view name_of(ColourSpace space);

/// Floating-point numbers of EXR files.
enum class Precision { half, single };

/// Reads a file as linear RGB, upright by its stated orientation. A grey image is repeated in all channels.
/// Integer formats (PNG, JPEG) are decoded by the curve that they state, else as sRGB, then multiplied by
/// alpha, if any: transparent pixels are black. Radiance pictures are divided by their exposure. Other values
/// are returned as stored. Throws DeviceError for a missing file and FormatError for a truncated file or no
/// image. docs/reference/image-files.md lists the variants of the formats.
REFIELD_API Image read_image(const std::filesystem::path& path);

/// Writes an EXR of Y, RGB or premultiplied RGBA (ZIP), atomically, with the attribute `chromaticities` where
/// the colour space has any. Throws DeviceError where the disk refuses.
REFIELD_API void write_exr(const std::filesystem::path& path, const Image& image,
                           Precision precision = Precision::single, ColourSpace space = ColourSpace::camera);

}  // namespace v0_2
}  // namespace refield
