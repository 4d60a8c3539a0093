// SPDX-License-Identifier: Apache-2.0
#include "acquire/devices/pixel_formats.h"

#include <jpeglib.h>
#include <linux/videodev2.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <csetjmp>
#include <cstdio>

namespace refield {

namespace {

/// libjpeg's errors, kept instead of printed: it expects a jump away where an error is fatal.
struct JpegErrors : jpeg_error_mgr {
  std::jmp_buf escape;
  char message[JMSG_LENGTH_MAX] = "";
};

void keep_message(j_common_ptr decoder) {
  auto* errors = static_cast<JpegErrors*>(decoder->err);
  errors->format_message(decoder, errors->message);
}

void escape_from(j_common_ptr decoder) {
  keep_message(decoder);
  std::longjmp(static_cast<JpegErrors*>(decoder->err)->escape, 1);
}

/// Decodes into `out` [height × width × 3] and returns whether all of it came. Holds nothing that a jump
/// would leave behind.
bool decode(jpeg_decompress_struct& decoder, std::span<const std::uint8_t> jpeg, int width, int height,
            std::uint8_t* out) {
  auto& errors = static_cast<JpegErrors&>(*decoder.err);
  if (setjmp(errors.escape) != 0) return false;
  jpeg_create_decompress(&decoder);
  jpeg_mem_src(&decoder, jpeg.data(), jpeg.size());
  jpeg_read_header(&decoder, TRUE);
  decoder.out_color_space = JCS_RGB;
  jpeg_start_decompress(&decoder);
  if (static_cast<int>(decoder.output_width) != width || static_cast<int>(decoder.output_height) != height) {
    std::snprintf(errors.message, sizeof errors.message, "is of %u×%u pixels", decoder.output_width,
                  decoder.output_height);
    return false;
  }
  while (decoder.output_scanline < decoder.output_height) {
    JSAMPROW row = out + std::size_t{3} * width * decoder.output_scanline;
    jpeg_read_scanlines(&decoder, &row, 1);
  }
  jpeg_finish_decompress(&decoder);
  return errors.num_warnings == 0;  // a torn frame is filled with grey and warned of
}

using Samples = std::vector<std::uint16_t>;
using Line = const std::uint8_t*;
using enum PixelLayout;
using enum SamplePacking;

constexpr std::array formats = {
    PixelFormat{V4L2_PIX_FMT_SRGGB16, bayer_rggb, 16, words},
    PixelFormat{V4L2_PIX_FMT_SGRBG16, bayer_grbg, 16, words},
    PixelFormat{V4L2_PIX_FMT_SGBRG16, bayer_gbrg, 16, words},
    PixelFormat{V4L2_PIX_FMT_SBGGR16, bayer_bggr, 16, words},
    PixelFormat{V4L2_PIX_FMT_SRGGB14, bayer_rggb, 14, words},
    PixelFormat{V4L2_PIX_FMT_SGRBG14, bayer_grbg, 14, words},
    PixelFormat{V4L2_PIX_FMT_SGBRG14, bayer_gbrg, 14, words},
    PixelFormat{V4L2_PIX_FMT_SBGGR14, bayer_bggr, 14, words},
    PixelFormat{V4L2_PIX_FMT_SRGGB12, bayer_rggb, 12, words},
    PixelFormat{V4L2_PIX_FMT_SGRBG12, bayer_grbg, 12, words},
    PixelFormat{V4L2_PIX_FMT_SGBRG12, bayer_gbrg, 12, words},
    PixelFormat{V4L2_PIX_FMT_SBGGR12, bayer_bggr, 12, words},
    PixelFormat{V4L2_PIX_FMT_SRGGB12P, bayer_rggb, 12, mipi_12},
    PixelFormat{V4L2_PIX_FMT_SGRBG12P, bayer_grbg, 12, mipi_12},
    PixelFormat{V4L2_PIX_FMT_SGBRG12P, bayer_gbrg, 12, mipi_12},
    PixelFormat{V4L2_PIX_FMT_SBGGR12P, bayer_bggr, 12, mipi_12},
    PixelFormat{V4L2_PIX_FMT_SRGGB10, bayer_rggb, 10, words},
    PixelFormat{V4L2_PIX_FMT_SGRBG10, bayer_grbg, 10, words},
    PixelFormat{V4L2_PIX_FMT_SGBRG10, bayer_gbrg, 10, words},
    PixelFormat{V4L2_PIX_FMT_SBGGR10, bayer_bggr, 10, words},
    PixelFormat{V4L2_PIX_FMT_SRGGB10P, bayer_rggb, 10, mipi_10},
    PixelFormat{V4L2_PIX_FMT_SGRBG10P, bayer_grbg, 10, mipi_10},
    PixelFormat{V4L2_PIX_FMT_SGBRG10P, bayer_gbrg, 10, mipi_10},
    PixelFormat{V4L2_PIX_FMT_SBGGR10P, bayer_bggr, 10, mipi_10},
    PixelFormat{V4L2_PIX_FMT_SRGGB8, bayer_rggb, 8, bytes},
    PixelFormat{V4L2_PIX_FMT_SGRBG8, bayer_grbg, 8, bytes},
    PixelFormat{V4L2_PIX_FMT_SGBRG8, bayer_gbrg, 8, bytes},
    PixelFormat{V4L2_PIX_FMT_SBGGR8, bayer_bggr, 8, bytes},
    PixelFormat{V4L2_PIX_FMT_Y16, grey, 16, words},
    PixelFormat{V4L2_PIX_FMT_Y14, grey, 14, words},
    PixelFormat{V4L2_PIX_FMT_Y12, grey, 12, words},
    PixelFormat{V4L2_PIX_FMT_Y10, grey, 10, words},
    PixelFormat{V4L2_PIX_FMT_Y10P, grey, 10, mipi_10},
    PixelFormat{V4L2_PIX_FMT_GREY, grey, 8, bytes},
    PixelFormat{V4L2_PIX_FMT_RGB24, rgb, 8, bytes},
    PixelFormat{V4L2_PIX_FMT_BGR24, rgb, 8, bgr},
    PixelFormat{V4L2_PIX_FMT_YUYV, rgb, 8, yuyv},
    PixelFormat{V4L2_PIX_FMT_MJPEG, rgb, 8, mjpeg},
    PixelFormat{V4L2_PIX_FMT_JPEG, rgb, 8, mjpeg},
};

std::uint8_t to_byte(double value) {
  return static_cast<std::uint8_t>(std::lround(std::clamp(value, 0.0, 255.0)));
}

/// R'G'B' of Y'CbCr. Source: ITU-R BT.601-7 section 2.5 and BT.709-6 section 3.
void put_rgb(double y, double cb, double cr, const YuvCoding& coding, std::uint16_t* out) {
  const double red = coding.bt709 ? 0.2126 : 0.299;
  const double blue = coding.bt709 ? 0.0722 : 0.114;
  const double luma = coding.full_range ? y : (y - 16.0) * 255.0 / 219.0;
  const double chroma_scale = coding.full_range ? 1.0 : 255.0 / 224.0;
  const double r = luma + 2.0 * (1.0 - red) * (cr - 128.0) * chroma_scale;
  const double b = luma + 2.0 * (1.0 - blue) * (cb - 128.0) * chroma_scale;
  out[0] = to_byte(r);
  out[1] = to_byte((luma - red * r - blue * b) / (1.0 - red - blue));
  out[2] = to_byte(b);
}

/// Samples of pixel x of a line: one, or three of RGB.
void unpack_pixel(Line line, const PixelFormat& format, int x, const YuvCoding& coding, std::uint16_t* out) {
  const auto mask = static_cast<std::uint16_t>((1u << format.bits) - 1u);
  switch (format.packing) {
    case bytes:
      if (format.layout == rgb)
        std::copy_n(line + 3 * x, 3, out);
      else
        *out = line[x];
      return;
    case words:
      // Bits above the format's are zero by definition; a driver that breaks it must not break the tables.
      *out = static_cast<std::uint16_t>((line[2 * x] | line[2 * x + 1] << 8) & mask);
      return;
    case mipi_10:
      *out = static_cast<std::uint16_t>(line[x / 4 * 5 + x % 4] << 2 |
                                        (line[x / 4 * 5 + 4] >> (2 * (x % 4)) & 3));
      return;
    case mipi_12:
      *out = static_cast<std::uint16_t>(line[x / 2 * 3 + x % 2] << 4 |
                                        (line[x / 2 * 3 + 2] >> (4 * (x % 2)) & 15));
      return;
    case lsb_first: {
      const int first = x * format.bits, end = first + format.bits;
      unsigned bits = 0;
      for (int byte = first / 8; 8 * byte < end; ++byte)
        bits |= unsigned{line[byte]} << 8 * (byte - first / 8);
      *out = static_cast<std::uint16_t>(bits >> first % 8 & mask);
      return;
    }
    case gige_packed: {
      const int low_bits = format.bits - 8;
      const int low = line[x / 2 * 3 + 1] >> 4 * (x % 2) & ((1 << low_bits) - 1);
      *out = static_cast<std::uint16_t>(line[x / 2 * 3 + x % 2 * 2] << low_bits | low);
      return;
    }
    case bgr:
      std::reverse_copy(line + 3 * x, line + 3 * x + 3, out);
      return;
    default:
      put_rgb(line[2 * x], line[x / 2 * 4 + 1], line[x / 2 * 4 + 3], coding, out);
  }
}

void check_window(const FrameWindow& window, const PixelFormat& format, int width, int height) {
  const std::string text = "window " + std::to_string(window.x) + ", " + std::to_string(window.y) + ", " +
                           std::to_string(window.width) + ", " + std::to_string(window.height);
  if (window.x < 0 || window.y < 0 || window.width < 1 || window.height < 1 ||
      window.width > width - window.x || window.height > height - window.y)
    throw InputError(text, " does not lie within the frame of ", width, "×", height,
                     " pixels; it is left, top, width, height");
  const bool paired = is_bayer(format.layout) || format.packing == yuyv;
  if (paired && (window.x % 2 || window.y % 2 || window.width % 2 || window.height % 2))
    throw InputError(text, ": pixels share colours in pairs; give even numbers");
}

}  // namespace

std::vector<std::uint16_t> decode_jpeg_frame(std::span<const std::uint8_t> jpeg, int width, int height,
                                             const std::string& device) {
  JpegErrors errors;
  jpeg_std_error(&errors);
  errors.output_message = keep_message;
  errors.error_exit = escape_from;
  jpeg_decompress_struct decoder{};
  decoder.err = &errors;
  std::vector<std::uint8_t> bytes(std::size_t{3} * width * height);
  const bool complete = decode(decoder, jpeg, width, height, bytes.data());
  jpeg_destroy_decompress(&decoder);
  if (!complete) throw DeviceError(device, EIO, "sent a damaged MJPEG frame: ", errors.message);
  return {bytes.begin(), bytes.end()};
}

bool PixelFormat::is_raw() const {
  return packing != yuyv && packing != mjpeg && layout != rgb;
}

std::uint32_t fourcc_from_text(const std::string& text) {
  if (text.empty() || text.size() > 4)
    throw InputError("pixel format '", text,
                     "': give its code of at most four characters, such as RGGB or Y16");
  std::string padded = text;
  padded.resize(4, ' ');
  return v4l2_fourcc(padded[0], padded[1], padded[2], padded[3]);
}

std::string fourcc_text(std::uint32_t fourcc) {
  std::string text;
  for (int shift = 0; shift < 32; shift += 8) {
    const auto c = static_cast<char>(fourcc >> shift & 0x7f);
    text += c >= ' ' && c <= '~' ? c : '?';
  }
  text.erase(text.find_last_not_of(' ') + 1);
  return text;
}

std::optional<PixelFormat> find_v4l2_format(std::uint32_t fourcc) {
  const auto* found = std::ranges::find(formats, fourcc, &PixelFormat::fourcc);
  return found == formats.end() ? std::nullopt : std::optional(*found);
}

std::span<const PixelFormat> v4l2_formats() {
  return formats;
}

std::optional<PixelFormat> find_genicam_format(const std::string& name) {
  if (name == "RGB8" || name == "RGB8Packed") return PixelFormat{0, rgb, 8, bytes};
  if (name == "BGR8" || name == "BGR8Packed") return PixelFormat{0, rgb, 8, bgr};
  constexpr std::pair<const char*, PixelLayout> kinds[] = {{"Mono", grey},
                                                           {"BayerRG", bayer_rggb},
                                                           {"BayerGR", bayer_grbg},
                                                           {"BayerGB", bayer_gbrg},
                                                           {"BayerBG", bayer_bggr}};
  for (const auto& [kind, layout] : kinds)
    for (const int bits : {8, 10, 12, 14, 16}) {
      const std::string plain = kind + std::to_string(bits);
      if (name == plain) return PixelFormat{0, layout, bits, bits == 8 ? bytes : words};
      if (name == plain + "p" && bits > 8 && bits < 16) return PixelFormat{0, layout, bits, lsb_first};
      if (name == plain + "Packed" && (bits == 10 || bits == 12))
        return PixelFormat{0, layout, bits, gige_packed};
    }
  return std::nullopt;
}

std::size_t line_bytes(const PixelFormat& format, int width) {
  const auto pixels = static_cast<std::size_t>(width);
  switch (format.packing) {
    case bytes:
      return pixels * (format.layout == rgb ? 3 : 1);
    case bgr:
      return pixels * 3;
    case mipi_10:
    case lsb_first:
      return (pixels * static_cast<std::size_t>(format.bits) + 7) / 8;
    case mipi_12:
    case gige_packed:
      return (pixels * 12 + 7) / 8;
    case mjpeg:
      return 0;
    default:
      return pixels * 2;
  }
}

Samples unpack_frame(std::span<const std::uint8_t> data, const PixelFormat& format, int width, int height,
                     std::size_t bytes_per_line, const FrameWindow& window, const YuvCoding& coding,
                     const std::string& device) {
  check_window(window, format, width, height);
  Samples decoded;
  if (format.packing == mjpeg) decoded = decode_jpeg_frame(data, width, height, device);
  const std::size_t needed = bytes_per_line * (height - 1) + line_bytes(format, width);
  if (decoded.empty() && (bytes_per_line < line_bytes(format, width) || data.size() < needed))
    throw DeviceError(device, EIO, "gave ", data.size(), " bytes instead of ", needed,
                      "; the frame is damaged");
  const std::size_t channels = format.layout == rgb ? 3 : 1;
  Samples samples(channels * window.width * window.height);
  std::uint16_t* out = samples.data();
  for (int y = window.y; y < window.y + window.height; ++y)
    for (int x = window.x; x < window.x + window.width; ++x, out += channels)
      if (decoded.empty())
        unpack_pixel(data.data() + bytes_per_line * y, format, x, coding, out);
      else
        std::copy_n(decoded.data() + channels * (static_cast<std::size_t>(y) * width + x), channels, out);
  return samples;
}

}  // namespace refield
