// SPDX-License-Identifier: Apache-2.0
#include "relight/tiled_transfer.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <string>

#include "core/errors.h"
#include "relight/tile_layout.h"

namespace refield {

namespace {

/// Calls visit(array) for each of a tile's arrays, always in this order.
template <class Arrays, class Visit>
void for_each_array(Arrays& arrays, const Visit& visit) {
  visit(arrays.dense_start);
  visit(arrays.places);
  visit(arrays.support);
  visit(arrays.dense_kernels);
  visit(arrays.runs);
  visit(arrays.group);
  visit(arrays.record_kernel);
  visit(arrays.common);
  visit(arrays.scale);
  visit(arrays.sparse);
  visit(arrays.record_scale);
  visit(arrays.record_weight);
}
constexpr std::size_t arrays_of_tile = 12;
constexpr std::size_t cache_line = 64;
using Lengths = std::array<std::uint32_t, arrays_of_tile>;

constexpr std::size_t whole_words(std::size_t bytes) {
  return (bytes + 7) / 8 * 8;
}

/// Appends a tile to a piece of memory.
template <class Weight>
void append(const TileArrays<Weight, Vector>& tile, std::vector<std::byte>& memory) {
  std::size_t at = memory.size(), array = 0;
  std::size_t size = whole_words(sizeof(Lengths));
  Lengths lengths{};
  for_each_array(tile, [&](const auto& values) {
    lengths[array++] = static_cast<std::uint32_t>(values.size());
    size += whole_words(values.size() * sizeof(values[0]));
  });
  memory.resize(at + (size + cache_line - 1) / cache_line * cache_line);
  std::memcpy(memory.data() + at, &lengths, sizeof lengths);
  at += whole_words(sizeof lengths);
  for_each_array(tile, [&](const auto& values) {
    const std::size_t bytes = values.size() * sizeof(values[0]);
    if (bytes > 0) std::memcpy(memory.data() + at, values.data(), bytes);
    at += whole_words(bytes);
  });
}

}  // namespace

template <class Weight>
Tile<Weight> TiledTransfer<Weight>::tile(int at) const {
  const auto of_band = static_cast<std::size_t>(tiles_across() * band_rows);
  const Band& band = bands[static_cast<std::size_t>(at) / of_band];
  const std::byte* next = band.memory.data() + band.start[static_cast<std::size_t>(at) % of_band];
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
void TiledTransfer<Weight>::prefetch(int at, bool for_change) const {
  if (at >= tiles()) return;
  const auto of_band = static_cast<std::size_t>(tiles_across() * band_rows);
  const Band& band = bands[static_cast<std::size_t>(at) / of_band];
  const std::size_t tile = static_cast<std::size_t>(at) % of_band;
  const std::byte* begin = band.memory.data() + band.start[tile];
  const std::byte* end = for_change ? begin + band.change_until[tile] : begin + band.weights_from[tile];
  __builtin_prefetch(begin);  // the lengths
  if (!for_change) begin += band.whole_from[tile];
  for (const std::byte* line = begin; line < end; line += cache_line) __builtin_prefetch(line);
}

template <class Weight>
std::size_t TiledTransfer<Weight>::bytes() const {
  std::size_t sum = common.size() * sizeof(common[0]);
  for (const Band& band : bands) sum += band.memory.size();
  return sum;
}

namespace {

void require_nameable(const LightDomain& domain) {
  if (domain.width > small_box_limit || domain.height > small_box_limit)
    throw InputError("the field's light map of " + std::to_string(domain.width) + "×" +
                     std::to_string(domain.height) + " texels is larger than tiles can name (" +
                     std::to_string(small_box_limit) + "); use a smaller light map");
}

/// Lays out rows of tiles, each row as a task.
template <class Weight>
typename TiledTransfer<Weight>::Band lay_out_band(const ReflectanceField& field,
                                                  const std::vector<std::uint32_t>& common_place,
                                                  int first_row, int rows, int across,
                                                  tbb::enumerable_thread_specific<TileWorkshop>& workshops) {
  std::vector<std::vector<std::byte>> memory(static_cast<std::size_t>(rows));
  std::vector<std::vector<std::uint32_t>> ends(static_cast<std::size_t>(rows));
  tbb::parallel_for(0, rows, [&](int row) {
    auto& bytes = memory[static_cast<std::size_t>(row)];
    for (int column = 0; column < across; ++column) {
      append(lay_out_tile<Weight>(field, common_place, column, first_row + row, workshops.local()), bytes);
      ends[static_cast<std::size_t>(row)].push_back(static_cast<std::uint32_t>(bytes.size()));
    }
  });
  typename TiledTransfer<Weight>::Band band;
  std::size_t size = 0;
  for (const auto& bytes : memory) size += bytes.size();
  if (size > std::numeric_limits<std::uint32_t>::max())
    throw InputError("the field holds too many weights a pixel to be shown in real time");
  band.memory.reserve(size);
  band.start.push_back(0);
  for (int row = 0; row < rows; ++row) {
    const auto before = static_cast<std::uint32_t>(band.memory.size());
    auto& bytes = memory[static_cast<std::size_t>(row)];
    band.memory.insert(band.memory.end(), bytes.begin(), bytes.end());
    for (const std::uint32_t end : ends[static_cast<std::size_t>(row)]) band.start.push_back(before + end);
    bytes = {};
  }
  return band;
}

template <class T>
void forget(std::vector<T>& values, std::uint64_t first, std::uint64_t last) {
  forget_pages(values.data() + first, (last - first) * sizeof(T));
}

/// `used`: the field itself where it is given up as it is used.
template <class Weight>
TiledTransfer<Weight> lay_out(const ReflectanceField& field, ReflectanceField* used) {
  require_nameable(field.basis.domain);
  TiledTransfer<Weight> tiled{field.width, field.height, {}, {}};
  const int across = tiled.tiles_across();
  const std::vector<std::uint32_t> common_place = place_common_kernels(field, tiled.common);
  tbb::enumerable_thread_specific<TileWorkshop> workshops;
  constexpr int band_rows = TiledTransfer<Weight>::band_rows;
  for (int row = 0; row < tiled.tiles_down(); row += band_rows) {
    const int rows = std::min(band_rows, tiled.tiles_down() - row);
    auto& band =
        tiled.bands.emplace_back(lay_out_band<Weight>(field, common_place, row, rows, across, workshops));
    for (int at = row * across; at < (row + rows) * across; ++at) {
      const Tile<Weight> tile = tiled.tile(at);
      const std::byte* begin = band.memory.data() + band.start[static_cast<std::size_t>(at - row * across)];
      const auto offset = [&](const void* array) {
        return static_cast<std::uint32_t>(static_cast<const std::byte*>(array) - begin);
      };
      band.whole_from.push_back(offset(tile.support.data() + tile.common.size()));
      band.change_until.push_back(offset(tile.group.data()));
      band.weights_from.push_back(offset(tile.scale.data()));
    }
    if (used == nullptr) continue;
    const auto entry_of = [&](int tile_row) {
      const int y = std::min(tile_row * tile_side_px, field.height);
      return field.transfer.row_start[static_cast<std::size_t>(y) * static_cast<std::size_t>(field.width)];
    };
    forget(used->transfer.column, entry_of(row), entry_of(row + rows));
    forget(used->transfer.weight, 3 * entry_of(row), 3 * entry_of(row + rows));
  }
  return tiled;
}

}  // namespace

template <class Weight>
TiledTransfer<Weight> tile_transfer(const ReflectanceField& field) {
  return lay_out<Weight>(field, nullptr);
}

template <class Weight>
TiledTransfer<Weight> tile_transfer(ReflectanceField&& field) {
  auto tiled = lay_out<Weight>(field, &field);
  field.transfer = {};
  return tiled;
}

template TiledTransfer<std::uint8_t> tile_transfer<std::uint8_t>(const ReflectanceField&);
template TiledTransfer<std::uint16_t> tile_transfer<std::uint16_t>(const ReflectanceField&);
template TiledTransfer<std::uint8_t> tile_transfer<std::uint8_t>(ReflectanceField&&);
template TiledTransfer<std::uint16_t> tile_transfer<std::uint16_t>(ReflectanceField&&);
template struct TiledTransfer<std::uint8_t>;
template struct TiledTransfer<std::uint16_t>;

}  // namespace refield
