// SPDX-License-Identifier: Apache-2.0
#include "acquire/jpeg_frame.h"

#include <jpeglib.h>
#include <cerrno>
#include <csetjmp>
#include <cstdio>

#include "core/errors.h"

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
  if (!complete) throw DeviceError(device, EIO, std::string("sent a damaged MJPEG frame: ") + errors.message);
  return {bytes.begin(), bytes.end()};
}

}  // namespace refield
