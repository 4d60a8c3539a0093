// SPDX-License-Identifier: Apache-2.0
#include "core/transfer_tiles.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>

namespace refield {

namespace {

constexpr std::size_t arrays_of_tile = 12;
using Lengths = std::array<std::uint32_t, arrays_of_tile>;

constexpr std::size_t whole_words(std::size_t bytes) {
  return (bytes + 7) / 8 * 8;
}

}  // namespace

template <class Weight>
void append_tile(const TileArrays<Weight, Vector>& tile, std::vector<std::byte>& memory) {
  std::size_t at = memory.size(), array = 0;
  std::size_t size = whole_words(sizeof(Lengths));
  Lengths lengths{};
  for_each_array(tile, [&](const auto& values) {
    lengths[array++] = static_cast<std::uint32_t>(values.size());
    size += whole_words(values.size() * sizeof(values[0]));
  });
  memory.resize(at + (size + cache_line_bytes - 1) / cache_line_bytes * cache_line_bytes);
  std::memcpy(memory.data() + at, &lengths, sizeof lengths);
  at += whole_words(sizeof lengths);
  for_each_array(tile, [&](const auto& values) {
    const std::size_t bytes = values.size() * sizeof(values[0]);
    if (bytes > 0) std::memcpy(memory.data() + at, values.data(), bytes);
    at += whole_words(bytes);
  });
}

template <class Weight>
const std::byte* TiledTransfer<Weight>::begin_of(int at) const {
  const auto of_band = static_cast<std::size_t>(tiles_across()) * band_rows;
  const Band& band = bands[static_cast<std::size_t>(at) / of_band];
  return band.memory.data() + band.start[static_cast<std::size_t>(at) % of_band];
}

template <class Weight>
Tile<Weight> TiledTransfer<Weight>::tile(int at) const {
  const std::byte* next = begin_of(at);
  Lengths lengths;
  std::memcpy(&lengths, next, sizeof lengths);
  next += whole_words(sizeof lengths);
  Tile<Weight> tile;
  std::size_t array = 0;
  for_each_array(tile, [&](auto& values) {
    using Value = typename std::remove_reference_t<decltype(values)>::element_type;
    values = {reinterpret_cast<Value*>(next), lengths[array++]};
    next += whole_words(values.size_bytes());
  });
  return tile;
}

template <class Weight>
void TiledTransfer<Weight>::prefetch_for_change(int at) const {
  if (at >= tiles()) return;
  const auto of_band = static_cast<std::size_t>(tiles_across()) * band_rows;
  const Band& band = bands[static_cast<std::size_t>(at) / of_band];
  const std::size_t tile = static_cast<std::size_t>(at) % of_band;
  const std::byte* begin = band.memory.data() + band.start[tile];
  const std::byte* end = begin + band.change_until[tile];
  for (const std::byte* line = begin; line < end; line += cache_line_bytes) __builtin_prefetch(line);
}

template <class Weight>
std::size_t TiledTransfer<Weight>::bytes() const {
  std::size_t sum = common.size() * sizeof(common[0]);
  for (const Band& band : bands) sum += band.memory.size();
  return sum;
}

template <class Weight>
void TiledTransfer<Weight>::mark_parts() {
  int at = 0;
  for (Band& band : bands)
    for (std::size_t i = 0; i + 1 < band.start.size(); ++i) {
      const Tile<Weight> marked = tile(at++);
      const std::byte* begin = band.memory.data() + band.start[i];
      band.change_until.push_back(
          static_cast<std::uint32_t>(reinterpret_cast<const std::byte*>(marked.group.data()) - begin));
    }
}

template <class Weight>
std::uint64_t TiledTransfer<Weight>::bytes_stated(int at) const {
  Lengths lengths;
  std::memcpy(&lengths, begin_of(at), sizeof lengths);
  std::uint64_t bytes = whole_words(sizeof lengths);
  std::size_t array = 0;
  const Tile<Weight> none;
  for_each_array(none,
                 [&](const auto& values) { bytes += whole_words(lengths[array++] * sizeof(values[0])); });
  return bytes;
}

template void append_tile(const TileArrays<std::uint8_t, Vector>&, std::vector<std::byte>&);
template void append_tile(const TileArrays<std::uint16_t, Vector>&, std::vector<std::byte>&);
template struct TiledTransfer<std::uint8_t>;
template struct TiledTransfer<std::uint16_t>;

}  // namespace refield
