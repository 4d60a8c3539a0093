// SPDX-License-Identifier: Apache-2.0
#include "core/image/image_header.h"

#include <algorithm>
#include <cerrno>
#include <cstdio>

namespace refield {

FileBytes::FileBytes(const fs::path& path) : size_(fs::file_size(path)) {
  file_.rdbuf()->pubsetbuf(nullptr, 0);  // each place would fill the buffer anew
  file_.open(path, std::ios::binary);
}

std::string FileBytes::text(std::uint64_t at, std::uint64_t count) {
  std::string bytes(at < size_ ? std::min(count, size_ - at) : 0, '\0');
  file_.clear();
  file_.seekg(static_cast<std::streamoff>(at));
  file_.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  return bytes;
}

std::uint64_t FileBytes::number(std::uint64_t at, int bytes, bool is_big_endian) {
  const std::string stored = text(at, static_cast<std::uint64_t>(bytes));
  std::uint64_t value = 0;
  for (int i = 0; i < bytes; ++i) {
    const auto place = static_cast<std::size_t>(is_big_endian ? i : bytes - 1 - i);
    value = value << 8 | (place < stored.size() ? static_cast<unsigned char>(stored[place]) : 0u);
  }
  return value;
}

bool is_jpeg_frame(std::uint64_t marker) {
  return marker >= 0xffc0 && marker <= 0xffcf && marker != 0xffc4 && marker != 0xffc8 && marker != 0xffcc;
}

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

PromisedImage read_png_header(FileBytes& file) {
  // Behind the signature, and the length and name of the first chunk, which libpng insists on.
  const auto side = [&](std::uint64_t at) { return static_cast<std::int64_t>(file.number(at, 4, true)); };
  return {.width = side(16), .height = side(20), .channels = 4};
}

/// From marker to marker up to the frame header (ITU T.81, B.2.2), then counts the scans.
PromisedImage read_jpeg_header(FileBytes& file, const fs::path& path) {
  for (std::uint64_t at = 2; at + 4 < file.size();) {
    const std::uint64_t marker = file.number(at, 2, true), length = file.number(at + 2, 2, true);
    const bool has_length = marker > 0xff01 && marker < 0xffff && (marker < 0xffd0 || marker > 0xffd8);
    if (!has_length) {
      ++at;
      continue;
    }
    if (length < 2)
      throw FormatError(path, "has a segment of impossible length; the file is damaged or truncated");
    if (is_jpeg_frame(marker)) {
      const std::string rest = file.text(at, file.size());
      int scans = 0;
      for (auto scan = rest.find("\xff\xda"); scan != std::string::npos;
           scan = rest.find("\xff\xda", scan + 2))
        ++scans;
      if (scans > max_jpeg_scans)
        throw FormatError(path, "has more than ", max_jpeg_scans, " scans; the file is damaged or truncated");
      const auto value = [&](std::uint64_t from, int bytes) {
        return static_cast<std::int64_t>(file.number(at + from, bytes, true));
      };
      return {.width = value(7, 2), .height = value(5, 2), .channels = value(9, 1)};
    }
    at += 2 + length;
  }
  throw FormatError(path, "ends within its header; the file is damaged or truncated");
}

}  // namespace

const char* name_of(ImageFormat format) {
  constexpr std::array names = {"openexr", "hdr", "png", "jpeg", "tiff", "pnm"};
  return names.at(static_cast<std::size_t>(format));
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
    throw FormatError(path, "has impossible dimensions ", size, "; the file is damaged");
  if (promised.channels < 1 || promised.channels > max_channels)
    throw FormatError(path, "has ", promised.channels, " channels, more than ", max_channels,
                      " or none; the file is damaged");
  const std::int64_t pixels = std::max(promised.width * promised.height, promised.tile_pixels);
  const std::uint64_t bytes = static_cast<std::uint64_t>(pixels) * promised.channels * sizeof(float);
  const std::uint64_t held = fs::file_size(path);
  if (promised.least_bytes > held || (bytes > always_allowed_bytes && bytes / max_compression > held))
    throw FormatError(path, "is too small for the ", size,
                      " pixels that its header promises; the file is damaged or truncated");
}

void check_image_header(const fs::path& path, ImageFormat format) {
  if (format == ImageFormat::hdr) read_radiance_header(path);
  if (format == ImageFormat::exr)
    for (const PromisedImage& part : read_exr_headers(path)) require_plausible(part, path);
  FileBytes file(path);
  if (format == ImageFormat::png) require_plausible(read_png_header(file), path);
  if (format == ImageFormat::jpeg) require_plausible(read_jpeg_header(file, path), path);
}

}  // namespace refield
