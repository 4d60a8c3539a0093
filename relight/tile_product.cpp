// SPDX-License-Identifier: Apache-2.0
#include "relight/tile_product.h"

#include <tbb/blocked_range.h>
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

void store_sum(const double* sum, float* out) {
  for (int c = 0; c < 3; ++c) out[c] = static_cast<float>(sum[c]);
}

/// The change's part in one tile.
template <class Weight>
struct TouchedTile {
  Tile<Weight> tile;
  std::vector<std::int64_t> kernels;
  TouchedWeights weights;
};

/// Asks for what the weights and the pixels of a touched tile need.
template <class Weight>
void prefetch_touched(const TouchedTile<Weight>& touched, const Image& image, int x0, int y0) {
  const auto ask_for = [](const auto* first, std::size_t count) {
    const auto* begin = reinterpret_cast<const std::byte*>(first);
    const std::byte* last = reinterpret_cast<const std::byte*>(first + count) - 1;
    for (const std::byte* line = begin; line < last; line += cache_line_bytes) __builtin_prefetch(line);
    __builtin_prefetch(last);
  };
  for (const auto& own : touched.weights.dense) {
    ask_for(touched.tile.record_weight.data() + std::size_t{own.record} * touched.tile.record_size(),
            touched.tile.record_size());
    __builtin_prefetch(touched.tile.record_scale.data() + own.record);
  }
  for (const auto& own : touched.weights.sparse) {
    ask_for(touched.tile.sparse.data() + own.first_use, own.uses);
    __builtin_prefetch(touched.tile.scale.data() + own.kernel);
  }
  const int columns = std::min(tile_side_px, image.width - x0),
            rows = std::min(tile_side_px, image.height - y0);
  for (int y = y0; y < y0 + rows; ++y)
    ask_for(image.row(y).data() + std::ptrdiff_t{3} * x0, static_cast<std::size_t>(columns) * 3);
}

/// Lists the weights of the touched kernels.
template <class Weight>
void list_weights(TouchedTile<Weight>& touched) {
  const Tile<Weight>& tile = touched.tile;
  touched.weights.dense.clear();
  touched.weights.sparse.clear();
  auto run = tile.runs.begin();
  std::uint32_t run_kernel = 0, run_use = 0;  // the run's first ones
  std::uint32_t light = 0;
  const auto dense_from = [&](std::size_t i, std::uint32_t own_light) {
    for (std::uint32_t place = tile.dense_start[i]; place < tile.dense_start[i + 1]; ++place)
      touched.weights.dense.push_back(
          {tile.places[place] / groups_of_tile, tile.places[place] % groups_of_tile, own_light});
  };
  const bool all_dense = tile.dense_kernels.size() == tile.support.size();
  auto dense = tile.dense_kernels.begin();
  for (const std::int64_t number : touched.kernels) {
    const auto kernel = static_cast<std::uint32_t>(number);
    for (; kernel >= run_kernel + run->kernels; ++run) {
      run_use += run->kernels * run->uses;
      run_kernel += run->kernels;
    }
    if (run->uses > 0)
      touched.weights.sparse.push_back(
          {run_use + (kernel - run_kernel) * run->uses, run->uses, kernel, light});
    if (all_dense) {
      dense_from(kernel, light);
    } else {
      dense = std::lower_bound(dense, tile.dense_kernels.end(), kernel);
      if (dense != tile.dense_kernels.end() && *dense == kernel)
        dense_from(static_cast<std::size_t>(dense - tile.dense_kernels.begin()), light);
    }
    ++light;
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

/// The light of a change under the touched kernels, [kernels × 4].
template <class Weight, class Table>
void sum_change(const LightChange<Table>& change, const TouchedTile<Weight>& touched,
                std::vector<SmallBox>& parts, std::vector<float>& light) {
  parts.clear();
  for (const std::int64_t k : touched.kernels)
    parts.push_back(overlap(touched.tile.support[static_cast<std::size_t>(k)], change.within));
  light.resize(std::max(light.size(), parts.size() * 4));
  sum_boxes(change.difference, parts, light.data());
  const std::size_t smooth = change.smooth.size() / 3;
  float* sum = light.data();
  for (const std::int64_t number : touched.kernels) {
    const auto k = static_cast<std::size_t>(number);
    if (k >= touched.tile.common.size()) break;
    if (touched.tile.common[k] < smooth)
      store_sum(change.smooth.data() + std::size_t{3} * touched.tile.common[k], sum);
    sum += 4;
  }
}

/// What one thread needs for a change.
template <class Weight>
struct ChangeScratch {
  TouchedTile<Weight> now, next;
  std::vector<SmallBox> parts;
  std::vector<float> light;
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
  tbb::enumerable_thread_specific<std::vector<float>> scratches;
  tbb::parallel_for(0, transfer.tiles(), [&](int at) {
    transfer.prefetch(at + 1, false);
    const Tile<Weight> tile = transfer.tile(at);
    std::vector<float>& light = scratches.local();  // [kernels × 4], and the dense ones' again
    light.resize(std::max(light.size(), (tile.support.size() + tile.dense_kernels.size()) * 4));
    const std::size_t shared = tile.common.size();
    for (std::size_t k = 0; k < shared; ++k)
      std::memcpy(light.data() + 4 * k, common.data() + std::size_t{3} * tile.common[k], 4 * sizeof(float));
    sum_boxes(table, tile.support.subspan(shared), light.data() + 4 * shared);
    TileSums sums;
    sum_kernels(tile, light.data(), light.data() + 4 * tile.support.size(),
                transfer.tile(std::min(at + 1, transfer.tiles() - 1)), sums);
    store(transfer, at, sums, all_groups, false, image);
  });
}

template <class Weight, class Table>
void add_change(const TiledTransfer<Weight>& transfer, const LightChange<Table>& change, Image& image) {
  tbb::enumerable_thread_specific<ChangeScratch<Weight>> scratches;
  tbb::parallel_for(tbb::blocked_range<int>(0, transfer.tiles(), 16), [&](const auto& range) {
    ChangeScratch<Weight>& scratch = scratches.local();
    // While a tile is summed, memory brings what the next one needs: touched weights lie too far apart for
    // the processor to foresee them.
    const auto look_at = [&](int at, TouchedTile<Weight>& touched) {
      transfer.prefetch(at + 1, true);
      touched.tile = transfer.tile(at);
      find_touched(touched.tile.support, change.within, touched.kernels);
      list_weights(touched);
      if (!touched.kernels.empty())
        prefetch_touched(touched, image, at % transfer.tiles_across() * tile_side_px,
                         at / transfer.tiles_across() * tile_side_px);
    };
    look_at(range.begin(), scratch.next);
    for (int at = range.begin(); at < range.end(); ++at) {
      std::swap(scratch.now, scratch.next);
      if (at + 1 < range.end()) look_at(at + 1, scratch.next);
      if (scratch.now.kernels.empty()) continue;
      sum_change(change, scratch.now, scratch.parts, scratch.light);
      TileSums sums;
      const std::uint32_t groups =
          sum_touched(scratch.now.tile, scratch.now.weights, scratch.light.data(), sums);
      store(transfer, at, sums, groups, true, image);
    }
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
