// SPDX-License-Identifier: Apache-2.0
#include "core/field_io/packed_field.h"

#include "core/base/files.h"
#include "core/field_io/field_content.h"
#include "core/field_io/reflectance_field_file.h"

namespace refield {

namespace {

struct Entry {
  std::uint32_t column;
  std::array<float, 3> weight;
};

template <class Weight>
SparseTransfer expand(const TiledTransfer<Weight>& tiles, RowRange tile_rows, const NumberOfBox& number_of) {
  SparseTransfer transfer;
  const int across = tiles.tiles_across();
  const int first = tile_rows.first * across, last = tile_rows.last * across;
  std::size_t max_entries = 0;
  for (int at = first; at < last; ++at)
    max_entries += tiles.tile(at).sparse.size() + tiles.tile(at).record_kernel.size() * group_pixels;
  transfer.column.reserve(max_entries);
  transfer.weight.reserve(3 * max_entries);
  std::vector<std::vector<Entry>> rows(static_cast<std::size_t>(tile_side_px) * tiles.width);
  std::vector<std::uint32_t> numbers;  // of a tile's kernels, in the basis
  for (int at = first; at < last; ++at) {
    const Tile<Weight> tile = tiles.tile(at);
    numbers.clear();
    for (const std::uint32_t place : tile.common) numbers.push_back(tiles.common[place]);
    for (const SmallBox& box : tile.support.subspan(numbers.size()))
      numbers.push_back(number_of({box.x0, box.y0, box.x1, box.y1}));
    const int left = at % across * tile_side_px, top = at / across * tile_side_px;
    for_each_weight(tile, [&](std::size_t kernel, std::size_t pixel, const std::array<float, 3>& weight) {
      const int x = left + column_of_tile(pixel), y = row_of_tile(pixel);
      if (x < tiles.width && top + y < tiles.height)
        rows[static_cast<std::size_t>(y) * tiles.width + x].push_back({numbers[kernel], weight});
    });
    if (at % across != across - 1) continue;
    for (std::size_t p = 0; p < rows.size(); ++p) {
      if (top + static_cast<int>(p) / tiles.width >= tiles.height) break;
      for (const Entry& entry : rows[p]) {
        transfer.column.push_back(entry.column);
        transfer.weight.insert(transfer.weight.end(), entry.weight.begin(), entry.weight.end());
      }
      transfer.row_start.push_back(transfer.column.size());
      rows[p].clear();
    }
  }
  return transfer;
}

}  // namespace

SparseTransfer expand_tiles(const TransferTiles& tiles, RowRange tile_rows, const NumberOfBox& number_of) {
  return std::visit([&](const auto& of_bits) { return expand(of_bits, tile_rows, number_of); }, tiles);
}

ReflectanceField expand(PackedField&& packed) {
  ReflectanceField field{std::move(packed.outline), {}};
  const int tiles_down = std::visit([](const auto& tiles) { return tiles.tiles_down(); }, packed.tiles);
  field.transfer = expand_tiles(packed.tiles, {0, tiles_down}, [&](const Box& box) {
    field.basis.boxes.push_back(box);
    return static_cast<std::uint32_t>(field.basis.size() - 1);
  });
  return field;
}

namespace {

using Word = std::uint32_t;

/// Where each tile begins in the memory of all bands one after another; at the end, its size.
template <class Weight>
std::vector<std::uint64_t> starts_of(const TiledTransfer<Weight>& tiles) {
  std::vector<std::uint64_t> starts{0};
  for (const auto& band : tiles.bands) {
    const std::uint64_t before = starts.back();
    for (std::size_t i = 1; i < band.start.size(); ++i) starts.push_back(before + band.start[i]);
  }
  return starts;
}

template <class Weight>
void write_tiles(const Hdf5Writer& writer, const TiledTransfer<Weight>& tiles) {
  const std::vector<std::uint64_t> starts = starts_of(tiles);
  writer.dataset("tiles/start", starts.data(), {starts.size()});
  Hdf5DataSetWriter<Word> memory(writer, "tiles/memory", {starts.back() / sizeof(Word)});
  for (const auto& band : tiles.bands)
    memory.append({reinterpret_cast<const Word*>(band.memory.data()), band.memory.size() / sizeof(Word)});
  memory.finish();
}

/// Reads the tiles' memory band by band; looks at no tile itself.
template <class Weight>
TiledTransfer<Weight> read_tiles(const Hdf5Values& values, const FieldOutline& outline) {
  TiledTransfer<Weight> tiles{outline.width, outline.height, {}, {}};
  const auto starts = values.dataset<std::uint64_t>("tiles/start", 1);
  const Hdf5DataSet& set = values.locate("tiles/memory", "u4", 1);
  // In 64 bits, and before any band is made: the size of the picture may be a lie.
  const auto in_tiles = [](int pixels) { return (std::int64_t{pixels} + tile_side_px - 1) / tile_side_px; };
  const auto count = static_cast<std::uint64_t>(in_tiles(outline.width) * in_tiles(outline.height));
  if (count > std::numeric_limits<std::int32_t>::max() || starts.size() != count + 1 || starts.front() != 0 ||
      starts.back() != set.bytes || !std::ranges::is_sorted(starts) ||
      std::ranges::any_of(starts, [](std::uint64_t start) { return start % cache_line_bytes != 0; }))
    values.fail("tiles/start does not fit the image size or tiles/memory");
  Hdf5Pieces pieces(values, "tiles/memory", set);
  const std::uint64_t of_band = static_cast<std::uint64_t>(tiles.tiles_across()) * tiles.band_rows;
  for (std::uint64_t first = 0; first < count; first += of_band) {
    auto& band = tiles.bands.emplace_back();
    const std::uint64_t end = std::min(first + of_band, count);
    const std::uint64_t bytes = starts[end] - starts[first];
    if (bytes > std::numeric_limits<std::uint32_t>::max()) values.fail("tiles/memory holds too large tiles");
    for (std::uint64_t at = first; at <= end; ++at)
      band.start.push_back(static_cast<std::uint32_t>(starts[at] - starts[first]));
    band.memory.resize(bytes);
    pieces.read(band.memory);
  }
  pieces.finish();
  tiles.common.resize(outline.basis.size());
  for (std::uint32_t k = 0; k < tiles.common.size(); ++k) tiles.common[k] = k;
  return tiles;
}

}  // namespace

void write_packed_field(const fs::path& path, const PackedField& packed) {
  require_readable(fault_of_statistics(packed.outline), path);
  require_readable(fault_of_tiles(packed), path);
  const std::size_t bytes = std::visit([](const auto& tiles) { return tiles.bytes(); }, packed.tiles);
  require_free_space(fs::absolute(path).parent_path(), outline_bytes(packed.outline) + bytes);
  write_atomically(path, [&](const fs::path& temporary) {
    Hdf5Writer writer(temporary, path);
    for (const char* group : {"basis", "tiles", "statistics"}) writer.group(group);
    write_outline(writer, packed.outline, packed_field_version, nullptr);
    writer.number("weight_bits", packed.bits());
    std::visit([&](const auto& tiles) { write_tiles(writer, tiles); }, packed.tiles);
    write_statistics(writer, packed.outline.quality);
    writer.finish();
  });
}

PackedField read_packed(const Hdf5Values& values) {
  PackedField packed{read_outline(values), {}};
  FieldOutline& outline = packed.outline;
  read_boxes(values, outline);
  if (outline.basis.domain.width > small_box_limit || outline.basis.domain.height > small_box_limit)
    values.fail("has a larger light map than packed fields can");
  const int bits = values.number("weight_bits");
  if (bits == 8)
    packed.tiles = read_tiles<std::uint8_t>(values, outline);
  else if (bits == 16)
    packed.tiles = read_tiles<std::uint16_t>(values, outline);
  else
    values.fail("has weights of " + std::to_string(bits) + " bits, not 8 or 16");
  if (const std::string fault = fault_of_tiles(packed); !fault.empty()) values.fail(fault);
  std::visit([](auto& tiles) { tiles.mark_parts(); }, packed.tiles);
  read_statistics(values, outline);
  return packed;
}

}  // namespace refield
