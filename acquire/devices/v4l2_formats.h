// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "acquire/camera.h"

namespace refield {

/// RGB samples, 8 bits, of one MJPEG frame: [height × width × 3], top row first. Frames without Huffman
/// tables, as USB cameras send them, are read with the standard's own. Throws DeviceError naming `device`
/// when the data are torn or of another size.
std::vector<std::uint16_t> decode_jpeg_frame(std::span<const std::uint8_t> jpeg, int width, int height,
                                             const std::string& device);

/// How the samples of a V4L2 pixel format lie in memory.
enum class SamplePacking {
  bytes,    ///< one sample a byte
  words,    ///< one sample in the low bits of a 16-bit word, low byte first
  mipi_10,  ///< four samples in five bytes: high bytes, then the low two bits of each
  mipi_12,  ///< two samples in three bytes: high bytes, then the low four bits of each
  bgr,      ///< one byte a sample, blue first
  yuyv,     ///< luma of each pixel, chroma of each pair: not raw, converted to RGB
  mjpeg     ///< compressed: not raw, decoded to RGB
};

/// A V4L2 pixel format that this program reads. Source: Linux media subsystem documentation, "Image formats".
struct V4l2Format {
  std::uint32_t fourcc;
  PixelLayout layout;
  int bits;
  SamplePacking packing;

  /// False when the camera has already processed the samples (white balance, tone curve, compression): HDR
  /// and noise figures then need a measured response, and chroma is shared by neighbours.
  bool is_raw() const;
};

/// Colour coding of YUYV frames: luma weights (ITU-R BT.601 or BT.709) and range (16 to 235, or full).
struct YuvCoding {
  bool bt709 = false;
  bool full_range = false;
};

/// "RGGB" or "Y10 " as the four bytes that drivers use; shorter text is filled with spaces. Throws InputError
/// for text that is empty or longer than four characters.
std::uint32_t fourcc_from_text(const std::string& text);
/// Without the spaces at its end.
std::string fourcc_text(std::uint32_t fourcc);

/// nullopt: this program cannot read the format.
std::optional<V4l2Format> find_v4l2_format(std::uint32_t fourcc);
/// Every format that this program reads, the better for measuring first: raw before processed, more bits
/// first.
std::span<const V4l2Format> v4l2_formats();

/// A window of a frame, pixels.
struct FrameWindow {
  int x = 0;
  int y = 0;
  int width = 0;
  int height = 0;
};

/// Samples of one frame's `window` as RawFrame keeps them. `bytes` holds `height` lines of `bytes_per_line`;
/// of MJPEG, a JPEG file. Throws InputError when the window does not lie within the frame (for Bayer and
/// YUYV: not at even places), DeviceError naming `device` when the driver gave fewer bytes than a frame has.
std::vector<std::uint16_t> unpack_v4l2(std::span<const std::uint8_t> bytes, const V4l2Format& format,
                                       int width, int height, std::size_t bytes_per_line,
                                       const FrameWindow& window, const YuvCoding& coding,
                                       const std::string& device);

}  // namespace refield
