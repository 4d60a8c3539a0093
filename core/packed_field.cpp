// SPDX-License-Identifier: Apache-2.0
#include "core/packed_field.h"

#include <array>
#include <utility>
#include <vector>

namespace refield {

namespace {

struct Entry {
  std::uint32_t column;
  std::array<float, 3> weight;
};

template <class Weight>
ReflectanceField expand(ReflectanceField&& outline, const TiledTransfer<Weight>& tiles) {
  ReflectanceField field = std::move(outline);
  field.transfer = {};
  std::size_t most_entries = 0;
  for (int at = 0; at < tiles.tiles(); ++at)
    most_entries += tiles.tile(at).sparse.size() + tiles.tile(at).record_kernel.size() * group_pixels;
  field.transfer.column.reserve(most_entries);
  field.transfer.weight.reserve(3 * most_entries);
  field.transfer.row_start.reserve(static_cast<std::size_t>(field.width) * field.height + 1);
  const int across = tiles.tiles_across();
  std::vector<std::vector<Entry>> rows(static_cast<std::size_t>(tile_side_px) * field.width);
  std::vector<std::uint32_t> numbers;  // of a tile's kernels, in the basis
  for (int at = 0; at < tiles.tiles(); ++at) {
    const Tile<Weight> tile = tiles.tile(at);
    numbers.assign(tile.common.begin(), tile.common.end());
    for (const SmallBox& box : tile.support.subspan(numbers.size())) {
      numbers.push_back(static_cast<std::uint32_t>(field.basis.size()));
      field.basis.boxes.push_back({box.x0, box.y0, box.x1, box.y1});
    }
    const int left = at % across * tile_side_px, top = at / across * tile_side_px;
    for_each_weight(tile, [&](std::size_t kernel, std::size_t pixel, const std::array<float, 3>& weight) {
      const int x = left + column_of_tile(pixel), y = row_of_tile(pixel);
      if (x < field.width && top + y < field.height)
        rows[static_cast<std::size_t>(y) * field.width + x].push_back({numbers[kernel], weight});
    });
    if (at % across != across - 1) continue;
    for (std::size_t p = 0; p < rows.size(); ++p) {
      if (top + static_cast<int>(p) / field.width >= field.height) break;
      for (const Entry& entry : rows[p]) {
        field.transfer.column.push_back(entry.column);
        field.transfer.weight.insert(field.transfer.weight.end(), entry.weight.begin(), entry.weight.end());
      }
      field.transfer.row_start.push_back(field.transfer.column.size());
      rows[p].clear();
    }
  }
  return field;
}

}  // namespace

ReflectanceField expand(PackedField&& packed) {
  return std::visit([&](const auto& tiles) { return expand(std::move(packed.outline), tiles); },
                    packed.tiles);
}

}  // namespace refield
