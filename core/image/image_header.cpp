// SPDX-License-Identifier: Apache-2.0
#include "core/image/image_header.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <cstdio>
#include <optional>
#include <string>
#include <string_view>

#include "core/base/errors.h"
#include "core/image/radiance_file.h"

namespace refield {

ByteReader::ByteReader(const std::filesystem::path& path)
    : path_(path), file_(path, std::ios::binary), size_(std::filesystem::file_size(path)) {
  if (!file_) throw DeviceError(path.string(), errno, "cannot open");
}

void ByteReader::fail(const std::string& what) const {
  throw FormatError(path_, what + "; the file is damaged or truncated");
}

std::uint64_t ByteReader::left() {
  return size_ - static_cast<std::uint64_t>(file_.tellg());
}

void ByteReader::skip(std::int64_t bytes) {
  if (bytes < 0 || static_cast<std::uint64_t>(bytes) > left()) fail("ends within its header");
  // Seeking would discard the stream's buffer, and read it again for every attribute of a header.
  constexpr std::int64_t short_way = 4096;
  if (bytes <= short_way)
    file_.ignore(bytes);
  else
    file_.seekg(bytes, std::ios::cur);
}

int ByteReader::byte() {
  const int value = file_.get();
  if (value == std::ifstream::traits_type::eof()) fail("ends within its header");
  return value;
}

std::uint64_t ByteReader::big_endian(int bytes) {
  std::uint64_t value = 0;
  for (int i = 0; i < bytes; ++i) value = value << 8 | static_cast<std::uint64_t>(byte());
  return value;
}

std::uint64_t ByteReader::little_endian(int bytes) {
  std::uint64_t value = 0;
  for (int i = 0; i < bytes; ++i) value |= static_cast<std::uint64_t>(byte()) << (8 * i);
  return value;
}

std::string ByteReader::until(char end, std::size_t longest) {
  std::string text;
  for (int value = byte(); value != static_cast<unsigned char>(end); value = byte()) {
    if (text.size() == longest) fail("has a name or line of more than " + std::to_string(longest) + " bytes");
    text.push_back(static_cast<char>(value));
  }
  return text;
}

int ByteReader::count(std::string_view pair) {
  int found = 0, before = -1;
  for (int value = file_.get(); value != std::ifstream::traits_type::eof(); value = file_.get()) {
    found += before == static_cast<unsigned char>(pair[0]) && value == static_cast<unsigned char>(pair[1]);
    before = value;
  }
  return found;
}

namespace {

constexpr std::uint32_t tiled_flag = 0x200, deep_flag = 0x800, multipart_flag = 0x1000;
constexpr std::size_t longest_name = 255;
constexpr std::uint64_t offset_bytes = 8;
constexpr std::uint64_t least_chunk_bytes = 8;  // row number and size
constexpr int max_parts = 1024;
constexpr const char* deep_text = "is a deep image, which has no single colour per pixel; flatten it";
/// Rows that are compressed together, by the number of the compression.
constexpr std::array<int, 10> rows_of_chunk = {1, 1, 1, 16, 32, 16, 32, 32, 32, 256};

/// The attributes of one header that decide how much memory decoding takes.
struct Header {
  std::optional<std::array<std::int64_t, 4>> data_window;
  std::optional<int> compression;
  std::optional<std::int64_t> channels;
  std::optional<std::array<std::int64_t, 2>> tile;
  std::string type;
  std::optional<Chromaticities> chromaticities;
  std::optional<bool> is_cube;
};

/// Ends reading of a file that is whole but holds what refield cannot use.
[[noreturn]] void refuse(const ByteReader& reader, const std::string& what) {
  throw FormatError(reader.path(), what);
}

std::int64_t read_channels(ByteReader& reader) {
  for (std::int64_t count = 0;; ++count) {
    const std::string name = reader.zero_terminated(longest_name);
    if (name.empty()) return count;
    const std::int32_t pixel_type = reader.little_endian_int32();
    reader.skip(4);
    const std::int32_t x_sampling = reader.little_endian_int32(), y_sampling = reader.little_endian_int32();
    if (pixel_type < 0 || pixel_type > 2) reader.fail("has a channel of unknown type");
    if (x_sampling != 1 || y_sampling != 1)
      refuse(reader, "has sub-sampled channels (luminance and chroma); export it as RGB");
    const std::string last = name.substr(name.rfind('.') + 1);
    if (pixel_type == 0 && (last == "R" || last == "G" || last == "B" || last == "Y"))
      refuse(reader, "stores '" + name + "' as whole numbers (uint), not as light; export half or float");
  }
}

void read_attribute(ByteReader& reader, const std::string& name, Header& header) {
  const std::string type = reader.zero_terminated(longest_name);
  const std::int32_t size = reader.little_endian_int32();
  if (size < 0 || static_cast<std::uint64_t>(size) > reader.left())
    reader.fail("has an attribute '" + name + "' of impossible size");
  const std::uint64_t left_after = reader.left() - static_cast<std::uint64_t>(size);
  if (name == "dataWindow" && size == 16) {
    auto& window = header.data_window.emplace();
    for (std::int64_t& edge : window) edge = reader.little_endian_int32();
  } else if (name == "compression" && size == 1) {
    header.compression = reader.byte();
  } else if (name == "tiles" && size == 9) {
    header.tile = {static_cast<std::int64_t>(reader.little_endian(4)),
                   static_cast<std::int64_t>(reader.little_endian(4))};
  } else if (name == "channels") {
    header.channels = read_channels(reader);
  } else if (name == "envmap" && size == 1) {
    header.is_cube = reader.byte() == 1;
  } else if (name == "chromaticities" && size == 32) {
    for (Eigen::Vector2d& xy : header.chromaticities.emplace())
      for (double& value : xy) value = std::bit_cast<float>(reader.little_endian_int32());
  } else if (name == "type") {
    for (std::int32_t i = 0; i < size; ++i) header.type.push_back(static_cast<char>(reader.byte()));
  }
  if (reader.left() < left_after) reader.fail("has an attribute '" + name + "' of the wrong size");
  reader.skip(static_cast<std::int64_t>(reader.left() - left_after));
}

std::uint64_t divided_up(std::int64_t a, std::int64_t b) {
  return static_cast<std::uint64_t>((a + b - 1) / b);
}

PromisedImage promised_by(const Header& header, bool tiled, ByteReader& reader) {
  if (!header.data_window || !header.compression || !header.channels)
    reader.fail("lacks dataWindow, compression or channels in its header");
  if (*header.compression >= static_cast<int>(rows_of_chunk.size()))
    reader.fail("is compressed in an unknown way");
  if (header.type.starts_with("deep")) refuse(reader, deep_text);
  const auto& window = *header.data_window;
  PromisedImage promised;
  promised.width = window[2] - window[0] + 1;
  promised.height = window[3] - window[1] + 1;
  promised.channels = *header.channels;
  promised.chromaticities = header.chromaticities;
  promised.is_cube = header.is_cube;
  if (promised.width <= 0 || promised.height <= 0) return promised;  // refused for that
  std::uint64_t chunks = divided_up(promised.height, rows_of_chunk[*header.compression]);
  if (tiled || header.type == "tiledimage") {
    if (!header.tile || (*header.tile)[0] < 1 || (*header.tile)[1] < 1)
      reader.fail("is tiled, but states no size of tiles");
    // Above this, products of two sizes might overflow; require_plausible() refuses them by far.
    constexpr std::int64_t largest = 1 << 24;
    if ((*header.tile)[0] > largest || (*header.tile)[1] > largest) reader.fail("has impossibly large tiles");
    promised.tile_pixels = (*header.tile)[0] * (*header.tile)[1];
    chunks = divided_up(promised.width, (*header.tile)[0]) * divided_up(promised.height, (*header.tile)[1]);
  }
  promised.least_bytes = chunks * (offset_bytes + least_chunk_bytes);
  return promised;
}

}  // namespace

std::vector<PromisedImage> read_exr_headers(ByteReader& reader) {
  reader.skip(4);  // magic number
  const auto version = static_cast<std::uint32_t>(reader.little_endian(4));
  if ((version & 0xff) != 2) reader.fail("is of an unknown version of OpenEXR");
  if (version & deep_flag) refuse(reader, deep_text);
  std::vector<PromisedImage> parts;
  for (int part = 0; part < max_parts; ++part) {
    std::string name = reader.zero_terminated(longest_name);
    if (name.empty() && part > 0) return parts;
    Header header;
    for (; !name.empty(); name = reader.zero_terminated(longest_name)) read_attribute(reader, name, header);
    parts.push_back(promised_by(header, (version & tiled_flag) != 0, reader));
    if (!(version & multipart_flag)) return parts;
  }
  reader.fail("has more than " + std::to_string(max_parts) + " parts");
}

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
    case ImageFormat::hdr: {
      const RadianceHeader header = read_radiance_header(path);
      require_plausible({header.width, header.height, 3}, path);
      break;
    }
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
