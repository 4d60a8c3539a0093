// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>

#include "acquire/camera.h"
#include "acquire/devices/tethered_camera.h"

namespace refield {

/// RGB samples, 8 bits, of one MJPEG frame: [height × width × 3], top row first. Frames without Huffman
/// tables, as USB cameras send them, are read with the standard's own. Throws DeviceError naming `device`
/// when the data are torn or of another size.
std::vector<std::uint16_t> decode_jpeg_frame(std::span<const std::uint8_t> jpeg, int width, int height,
                                             const std::string& device);

/// How the samples of a pixel format lie in memory.
enum class SamplePacking {
  bytes,        ///< one sample a byte
  words,        ///< one sample in the low bits of a 16-bit word, low byte first
  mipi_10,      ///< four samples in five bytes: high bytes, then the low two bits of each
  mipi_12,      ///< two samples in three bytes: high bytes, then the low four bits of each
  lsb_first,    ///< a stream of bits, the low bits of a sample first: PFNC's formats that end in "p"
  gige_packed,  ///< two samples in three bytes: high bytes first and last, their low bits between them
  bgr,          ///< one byte a sample, blue first
  yuyv,         ///< luma of each pixel, chroma of each pair: not raw, converted to RGB
  mjpeg         ///< compressed: not raw, decoded to RGB
};

/// A pixel format that this program reads. Sources: Linux media subsystem documentation, "Image formats";
/// EMVA, "GenICam Pixel Format Naming Convention" 2.4; AIA, "GigE Vision" 2.0, section 27 (formats that end
/// in "Packed").
struct PixelFormat {
  std::uint32_t fourcc;  ///< of V4L2; 0 for a GenICam format
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
std::optional<PixelFormat> find_v4l2_format(std::uint32_t fourcc);
/// Every format that this program reads, the better for measuring first: raw before processed, more bits
/// first.
std::span<const PixelFormat> v4l2_formats();

/// The format that a GenICam camera calls `name`, such as "BayerRG12p"; nullopt: this program cannot read it.
std::optional<PixelFormat> find_genicam_format(const std::string& name);

/// Bytes of a line without padding; 0 for compressed formats.
std::size_t line_bytes(const PixelFormat& format, int width);

/// Samples of one frame's `window` as RawFrame keeps them. `bytes` holds `height` lines of `bytes_per_line`;
/// of MJPEG, a JPEG file. Throws InputError when the window does not lie within the frame (for Bayer and
/// YUYV: not at even places), DeviceError naming `device` when the driver gave fewer bytes than a frame has.
std::vector<std::uint16_t> unpack_frame(std::span<const std::uint8_t> bytes, const PixelFormat& format,
                                        int width, int height, std::size_t bytes_per_line,
                                        const FrameWindow& window, const YuvCoding& coding,
                                        const std::string& device);

}  // namespace refield
