// SPDX-License-Identifier: Apache-2.0
#include "core/image_header.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <string_view>

#include "core/byte_reader.h"
#include "core/errors.h"
#include "core/exr_header.h"

namespace refield {

namespace fs = std::filesystem;

namespace {

using namespace std::string_view_literals;

constexpr std::int64_t max_side_px = 1 << 16;  // beyond this a header is taken as hostile
constexpr std::int64_t max_channels = 256;
// No compression of real images reaches this; a header that promises more than the file can hold is damaged.
constexpr std::uint64_t max_compression = 5000;
constexpr std::uint64_t always_allowed_bytes = 64 << 20;
// Real progressive files have about ten. Each takes as long as decoding the whole image, however few bytes it
// has.
constexpr int max_jpeg_scans = 100;

PromisedImage read_png_header(ByteReader& reader) {
  reader.skip(8);  // signature
  reader.skip(8);  // length and name of the first chunk, which libpng insists on
  PromisedImage promised;
  promised.width = reader.big_endian(4);
  promised.height = reader.big_endian(4);
  promised.channels = 4;
  return promised;
}

/// From marker to marker up to the frame header (ITU T.81, B.2.2), then counts the scans.
PromisedImage read_jpeg_header(ByteReader& reader) {
  reader.skip(2);
  PromisedImage promised;
  for (;;) {
    while (reader.byte() != 0xff) {
    }
    int marker = 0xff;
    while (marker == 0xff) marker = reader.byte();
    const bool alone = marker == 0x00 || marker == 0x01 || (marker >= 0xd0 && marker <= 0xd8);
    if (alone) continue;
    const auto length = static_cast<std::int64_t>(reader.big_endian(2));
    if (length < 2) reader.fail("has a segment of impossible length");
    const bool frame_header =
        marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
    if (!frame_header) {
      reader.skip(length - 2);
      continue;
    }
    reader.skip(1);  // precision
    promised.height = reader.big_endian(2);
    promised.width = reader.big_endian(2);
    promised.channels = reader.byte();
    if (reader.count("\xff\xda"sv) > max_jpeg_scans)
      reader.fail("has more than " + std::to_string(max_jpeg_scans) + " scans");
    return promised;
  }
}

PromisedImage read_hdr_header(ByteReader& reader) {
  while (!reader.line().empty()) {
  }
  const std::string resolution = reader.line();
  PromisedImage promised;
  char first = 0, second = 0, sign[2] = {};
  long long a = 0, b = 0;
  if (std::sscanf(resolution.c_str(), "%c%c %9lld %c%c %9lld", &sign[0], &first, &a, &sign[1], &second, &b) !=
      6)
    reader.fail("states no resolution");
  promised.height = first == 'Y' ? a : b;
  promised.width = first == 'Y' ? b : a;
  promised.channels = 3;
  return promised;
}

}  // namespace

const char* name_of(ImageFormat format) {
  switch (format) {
    case ImageFormat::exr:
      return "openexr";
    case ImageFormat::hdr:
      return "hdr";
    case ImageFormat::png:
      return "png";
    case ImageFormat::jpeg:
      return "jpeg";
    case ImageFormat::tiff:
      return "tiff";
    case ImageFormat::pfm:
      return "pnm";
  }
  return "";
}

std::optional<ImageFormat> image_format(const fs::path& path) {
  static constexpr std::array known = {std::pair{"\x76\x2f\x31\x01"sv, ImageFormat::exr},
                                       std::pair{"#?RADIANCE"sv, ImageFormat::hdr},
                                       std::pair{"#?RGBE"sv, ImageFormat::hdr},
                                       std::pair{"\x89PNG\r\n\x1a\n"sv, ImageFormat::png},
                                       std::pair{"\xff\xd8\xff"sv, ImageFormat::jpeg},
                                       std::pair{"II*\0"sv, ImageFormat::tiff},
                                       std::pair{"MM\0*"sv, ImageFormat::tiff},
                                       std::pair{"II+\0"sv, ImageFormat::tiff},
                                       std::pair{"MM\0+"sv, ImageFormat::tiff},
                                       std::pair{"PF\n"sv, ImageFormat::pfm},
                                       std::pair{"Pf\n"sv, ImageFormat::pfm}};
  std::FILE* file = std::fopen(path.c_str(), "rbe");
  if (!file) throw DeviceError(path.string(), errno, "cannot open the image");
  std::array<char, 16> head{};
  const std::string_view start(head.data(), std::fread(head.data(), 1, head.size(), file));
  std::fclose(file);
  const auto found =
      std::ranges::find_if(known, [&](const auto& kind) { return start.starts_with(kind.first); });
  if (found == known.end()) return std::nullopt;
  return found->second;
}

void require_plausible(const PromisedImage& promised, const fs::path& path) {
  const std::string size = std::to_string(promised.width) + "×" + std::to_string(promised.height);
  if (promised.width <= 0 || promised.height <= 0 || promised.width > max_side_px ||
      promised.height > max_side_px)
    throw FormatError(path, "has impossible dimensions " + size + "; the file is damaged");
  if (promised.channels < 1 || promised.channels > max_channels)
    throw FormatError(path, "has " + std::to_string(promised.channels) + " channels, more than " +
                                std::to_string(max_channels) + " or none; the file is damaged");
  const std::int64_t pixels = std::max(promised.width * promised.height, promised.tile_pixels);
  const std::uint64_t bytes = static_cast<std::uint64_t>(pixels) * promised.channels * sizeof(float);
  const std::uint64_t held = fs::file_size(path);
  if (promised.least_bytes > held || (bytes > always_allowed_bytes && bytes / max_compression > held))
    throw FormatError(path, "is too small for the " + size +
                                " pixels that its header promises; the file is damaged or truncated");
}

void check_image_header(const fs::path& path, ImageFormat format) {
  ByteReader reader(path);
  switch (format) {
    case ImageFormat::exr:
      for (const PromisedImage& part : read_exr_headers(reader)) require_plausible(part, path);
      break;
    case ImageFormat::hdr:
      require_plausible(read_hdr_header(reader), path);
      break;
    case ImageFormat::png:
      require_plausible(read_png_header(reader), path);
      break;
    case ImageFormat::jpeg:
      require_plausible(read_jpeg_header(reader), path);
      break;
    case ImageFormat::tiff:
    case ImageFormat::pfm:
      break;
  }
}

}  // namespace refield
