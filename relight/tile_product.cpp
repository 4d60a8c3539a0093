// SPDX-License-Identifier: Apache-2.0
#include "relight/tile_product.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstring>

#include "relight/tile_vectors.h"

namespace refield {

namespace {

/// Where a tile lies in the image; `sums` go there, cut at the image's edges.
template <class Weight>
void store(const TiledTransfer<Weight>& transfer, int tile, const TileSums& sums, std::uint32_t groups,
           bool add, Image& image) {
  const int x0 = tile % transfer.tiles_across() * tile_side_px;
  const int y0 = tile / transfer.tiles_across() * tile_side_px;
  const int columns = std::min(tile_side_px, image.width - x0);
  const int rows = std::min(tile_side_px, image.height - y0);
  if (columns == tile_side_px && rows == tile_side_px) {
    store_groups(sums, groups, add, &image.at(x0, y0, 0), static_cast<std::size_t>(image.width) * 3);
    return;
  }
  float whole[tile_pixels * 3];
  store_groups(sums, all_groups, false, whole, tile_side_px * 3);
  for (int y = 0; y < rows; ++y)
    for (int i = 0; i < columns * 3; ++i) {
      float& value = (&image.at(x0, y0 + y, 0))[i];
      value = whole[y * tile_side_px * 3 + i] + (add ? value : 0.0f);
    }
}

/// What of a box lies in `within`, counted from its corner.
SmallBox overlap(const SmallBox& box, const Box& within) {
  const auto small = [](std::int32_t value) { return static_cast<std::int16_t>(value); };
  return {small(std::max<int>(box.x0, within.x0) - within.x0),
          small(std::max<int>(box.y0, within.y0) - within.y0),
          small(std::min<int>(box.x1, within.x1) - within.x0),
          small(std::min<int>(box.y1, within.y1) - within.y0)};
}

void store_sum(const double* sum, float* out) {
  for (int c = 0; c < 3; ++c) out[c] = static_cast<float>(sum[c]);
}

/// What one thread needs for a tile.
struct Scratch {
  std::vector<float> light;           // [kernels × 4]
  std::vector<std::int64_t> touched;  // kernels
  std::vector<SmallBox> parts;        // of them, in the change
};

}  // namespace

void sum_boxes(const FixedPointTable& table, std::span<const SmallBox> boxes, float* sums) {
  sum_boxes_fixed(table.corners(), table.stride(), table.step().data(), boxes.data(), boxes.size(), sums);
}

void sum_boxes(const SummedAreaTable& table, std::span<const SmallBox> boxes, float* sums) {
  for (const SmallBox& box : boxes) {
    store_sum(table.sum({box.x0, box.y0, box.x1, box.y1}).data(), sums);
    sums += 4;
  }
}

template <class Weight, class Table>
void multiply(const TiledTransfer<Weight>& transfer, const Coefficients& common, const Table& table,
              Image& image) {
  tbb::enumerable_thread_specific<Scratch> scratches;
  tbb::parallel_for(0, transfer.tiles(), [&](int at) {
    transfer.prefetch(at + 1, false);
    const Tile<Weight> tile = transfer.tile(at);
    std::vector<float>& light = scratches.local().light;
    light.resize(std::max(light.size(), (tile.support.size() + tile.dense_kernels.size()) * 4));
    const std::size_t shared = tile.common.size();
    for (std::size_t k = 0; k < shared; ++k)
      std::memcpy(light.data() + 4 * k, common.data() + std::size_t{3} * tile.common[k], 4 * sizeof(float));
    sum_boxes(table, tile.support.subspan(shared), light.data() + 4 * shared);
    TileSums sums;
    add_kernels(tile, light.data(), light.data() + 4 * tile.support.size(),
                transfer.tile(std::min(at + 1, transfer.tiles() - 1)), sums);
    store(transfer, at, sums, all_groups, false, image);
  });
}

template <class Weight, class Table>
void add_change(const TiledTransfer<Weight>& transfer, const LightChange<Table>& change, Image& image) {
  const std::size_t hats = change.hats.size() / 3;
  tbb::enumerable_thread_specific<Scratch> scratches;
  tbb::parallel_for(0, transfer.tiles(), [&](int at) {
    transfer.prefetch(at + 1, true);
    const Tile<Weight> tile = transfer.tile(at);
    Scratch& scratch = scratches.local();
    find_touched(tile.support, change.within, scratch.touched);
    if (scratch.touched.empty()) return;
    scratch.parts.clear();
    for (const std::int64_t k : scratch.touched)
      scratch.parts.push_back(overlap(tile.support[static_cast<std::size_t>(k)], change.within));
    scratch.light.resize(std::max(scratch.light.size(), scratch.parts.size() * 4));
    float* light = scratch.light.data();
    sum_boxes(change.difference, scratch.parts, light);
    for (const std::int64_t touched : scratch.touched) {
      const auto k = static_cast<std::size_t>(touched);
      if (k >= tile.common.size()) break;
      if (tile.common[k] < hats) store_sum(change.hats.data() + std::size_t{3} * tile.common[k], light);
      light += 4;
    }
    TileSums sums;
    const std::uint32_t groups = add_kernels(tile, scratch.touched, scratch.light.data(), sums);
    store(transfer, at, sums, groups, true, image);
  });
}

template void multiply(const TiledTransfer<std::uint8_t>&, const Coefficients&, const FixedPointTable&,
                       Image&);
template void multiply(const TiledTransfer<std::uint8_t>&, const Coefficients&, const SummedAreaTable&,
                       Image&);
template void multiply(const TiledTransfer<std::uint16_t>&, const Coefficients&, const FixedPointTable&,
                       Image&);
template void multiply(const TiledTransfer<std::uint16_t>&, const Coefficients&, const SummedAreaTable&,
                       Image&);
template void add_change(const TiledTransfer<std::uint8_t>&, const LightChange<FixedPointTable>&, Image&);
template void add_change(const TiledTransfer<std::uint8_t>&, const LightChange<SummedAreaTable>&, Image&);
template void add_change(const TiledTransfer<std::uint16_t>&, const LightChange<FixedPointTable>&, Image&);
template void add_change(const TiledTransfer<std::uint16_t>&, const LightChange<SummedAreaTable>&, Image&);

}  // namespace refield
