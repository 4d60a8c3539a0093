// SPDX-License-Identifier: Apache-2.0
#include "core/exr_header.h"

#include <array>
#include <optional>
#include <string>

namespace refield {

namespace {

constexpr std::uint32_t tiled_flag = 0x200, deep_flag = 0x800, multipart_flag = 0x1000;
constexpr std::size_t longest_name = 255;
constexpr std::uint64_t offset_bytes = 8;
constexpr std::uint64_t least_chunk_bytes = 8;  // row number and size
constexpr int most_parts = 1024;
/// Rows that are compressed together, by the number of the compression.
constexpr std::array<int, 10> rows_of_chunk = {1, 1, 1, 16, 32, 16, 32, 32, 32, 256};

/// The attributes of one header that decide how much memory decoding takes.
struct Header {
  std::optional<std::array<std::int64_t, 4>> data_window;
  std::optional<int> compression;
  std::optional<std::int64_t> channels;
  std::optional<std::array<std::int64_t, 2>> tile;
  std::string type;
};

std::int64_t read_channels(ByteReader& reader) {
  for (std::int64_t count = 0;; ++count) {
    if (reader.zero_terminated(longest_name).empty()) return count;
    const std::int32_t pixel_type = reader.little_endian_int32();
    reader.skip(4);
    const std::int32_t x_sampling = reader.little_endian_int32(), y_sampling = reader.little_endian_int32();
    if (pixel_type < 0 || pixel_type > 2) reader.fail("has a channel of unknown type");
    // The format allows sub-sampled channels; colour and noise of photographs never are.
    if (x_sampling != 1 || y_sampling != 1) reader.fail("has sub-sampled channels");
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
  if (header.type.starts_with("deep")) reader.fail("is a deep image, which cannot be used here");
  const auto& window = *header.data_window;
  PromisedImage promised;
  promised.width = window[2] - window[0] + 1;
  promised.height = window[3] - window[1] + 1;
  promised.channels = *header.channels;
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
  if (version & deep_flag) reader.fail("is a deep image, which cannot be used here");
  std::vector<PromisedImage> parts;
  for (int part = 0; part < most_parts; ++part) {
    std::string name = reader.zero_terminated(longest_name);
    if (name.empty() && part > 0) return parts;
    Header header;
    for (; !name.empty(); name = reader.zero_terminated(longest_name)) read_attribute(reader, name, header);
    parts.push_back(promised_by(header, (version & tiled_flag) != 0, reader));
    if (!(version & multipart_flag)) return parts;
  }
  reader.fail("has more than " + std::to_string(most_parts) + " parts");
}

}  // namespace refield
