// SPDX-License-Identifier: Apache-2.0
#include "relight/tiles/tiled_transfer.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <limits>
#include <numeric>
#include <string>

#include "core/base/errors.h"
#include "core/base/run_context.h"
#include "relight/tiles/tile_layout.h"

namespace refield {

namespace {

void require_nameable(const LightDomain& domain) {
  if (domain.width > small_box_limit || domain.height > small_box_limit)
    throw InputError("the field's light map of " + std::to_string(domain.width) + "×" +
                     std::to_string(domain.height) + " texels is larger than tiles can name (" +
                     std::to_string(small_box_limit) + "); use a smaller light map");
}

/// Lays out rows of tiles, each row as a task; calls `done` when the field's entries are no longer needed.
template <class Weight, class Done>
typename TiledTransfer<Weight>::Band lay_out_band(const ReflectanceField& field,
                                                  const std::vector<std::uint32_t>& common_place,
                                                  int first_row, int rows, int across,
                                                  tbb::enumerable_thread_specific<TileWorkshop>& workshops,
                                                  const Done& done) {
  std::vector<std::vector<std::byte>> tiles(static_cast<std::size_t>(rows) *
                                            static_cast<std::size_t>(across));
  tbb::parallel_for(0, rows, [&](int row) {
    for (int column = 0; column < across; ++column)
      append_tile(lay_out_tile<Weight>(field, common_place, column, first_row + row, workshops.local()),
                  tiles[static_cast<std::size_t>(row) * across + column]);
  });
  done();
  typename TiledTransfer<Weight>::Band band;
  std::size_t size = 0;
  for (const auto& bytes : tiles) size += bytes.size();
  if (size > std::numeric_limits<std::uint32_t>::max())
    throw InputError("the field holds too many weights per pixel for real-time display");
  band.memory.reserve(size);
  band.start.push_back(0);
  for (auto& bytes : tiles) {
    band.memory.insert(band.memory.end(), bytes.begin(), bytes.end());
    band.start.push_back(static_cast<std::uint32_t>(band.memory.size()));
    bytes = {};
  }
  return band;
}

template <class T>
void forget(FileVector<T>& values, std::uint64_t first, std::uint64_t last) {
  forget_pages(values.data() + first, (last - first) * sizeof(T));
}

/// `used`: the field itself where it is given up as it is used.
template <class Weight>
TiledTransfer<Weight> lay_out(const ReflectanceField& field, ReflectanceField* used) {
  require_nameable(field.basis.domain);
  TiledTransfer<Weight> tiled{field.width, field.height, {}, {}};
  const int across = tiled.tiles_across();
  CommonKernels kernels(field.basis);
  kernels.add(field, 0);
  const std::vector<std::uint32_t> common_place = kernels.places(tiled.common);
  tbb::enumerable_thread_specific<TileWorkshop> workshops;
  constexpr int band_rows = TiledTransfer<Weight>::band_rows;
  for (int row = 0; row < tiled.tiles_down(); row += band_rows) {
    const int rows = std::min(band_rows, tiled.tiles_down() - row);
    const auto entry_of = [&](int tile_row) {
      const int y = std::min(tile_row * tile_side_px, field.height);
      return field.transfer.row_start[static_cast<std::size_t>(y) * static_cast<std::size_t>(field.width)];
    };
    tiled.bands.push_back(lay_out_band<Weight>(field, common_place, row, rows, across, workshops, [&] {
      if (used == nullptr) return;
      forget(used->transfer.column, entry_of(row), entry_of(row + rows));
      forget(used->transfer.weight, 3 * entry_of(row), 3 * entry_of(row + rows));
    }));
  }
  tiled.mark_parts();
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

template <class Weight>
TiledTransfer<Weight> tile_transfer(const FieldRows& source, const RunContext& run) {
  const FieldOutline& outline = source.outline;
  require_nameable(outline.basis.domain);
  TiledTransfer<Weight> tiled{outline.width, outline.height, {}, {}};
  ReflectanceField band;  // some rows of the picture
  band.width = outline.width;
  band.basis = outline.basis;
  constexpr int band_rows = TiledTransfer<Weight>::band_rows;
  // Calls visit(first row of tiles, rows of tiles) for one band after another.
  const auto for_each_band = [&](const auto& visit) {
    for (int row = 0; row < tiled.tiles_down(); row += band_rows) {
      run.throw_if_stopped();
      const int rows = std::min(band_rows, tiled.tiles_down() - row);
      const RowRange range{row * tile_side_px, std::min(outline.height, (row + rows) * tile_side_px)};
      band.height = range.count();
      band.transfer = source.rows(range);
      visit(row, rows);
    }
  };
  std::vector<std::uint32_t> place(outline.basis.size());
  if (source.repeatable) {
    CommonKernels kernels(band.basis);
    for_each_band([&](int row, int) { kernels.add(band, row); });
    place = kernels.places(tiled.common);
  } else {
    std::iota(place.begin(), place.end(), 0u);
    tiled.common = place;
  }
  tbb::enumerable_thread_specific<TileWorkshop> workshops;
  for_each_band([&](int, int rows) {
    tiled.bands.push_back(lay_out_band<Weight>(band, place, 0, rows, tiled.tiles_across(), workshops, [] {}));
  });
  tiled.mark_parts();
  return tiled;
}

template TiledTransfer<std::uint8_t> tile_transfer<std::uint8_t>(const FieldRows&, const RunContext&);
template TiledTransfer<std::uint16_t> tile_transfer<std::uint16_t>(const FieldRows&, const RunContext&);
template TiledTransfer<std::uint8_t> tile_transfer<std::uint8_t>(const ReflectanceField&);
template TiledTransfer<std::uint16_t> tile_transfer<std::uint16_t>(const ReflectanceField&);
template TiledTransfer<std::uint8_t> tile_transfer<std::uint8_t>(ReflectanceField&&);
template TiledTransfer<std::uint16_t> tile_transfer<std::uint16_t>(ReflectanceField&&);

}  // namespace refield
