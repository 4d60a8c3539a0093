// SPDX-License-Identifier: Apache-2.0
#include "relight/tiles/tile_product.h"

#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <cstring>

#include "core/image/colour.h"

namespace refield {

void ChangedTexels::build(const Image& difference) {
  width_ = difference.width;
  counts_.clear();
  const auto changed = [](const float* texel) {
    return texel[0] != 0.0f || texel[1] != 0.0f || texel[2] != 0.0f;
  };
  std::size_t same = 0;
  for (std::size_t i = 0; i < difference.values.size(); i += 3) same += !changed(&difference.values[i]);
  if (same == 0) return;
  counts_.resize(place(0, difference.height + 1), 0);
  for (int y = 0; y < difference.height; ++y) {
    const float* texel = difference.row(y).data();
    const std::int32_t* above = counts_.data() + place(1, y);
    std::int32_t* counts = counts_.data() + place(1, y + 1);
    std::int32_t in_row = 0;
    for (int x = 0; x < width_; ++x, texel += 3) {
      in_row += changed(texel);
      counts[x] = above[x] + in_row;
    }
  }
}

namespace {

SmallBox bounds_of(std::span<const SmallBox> boxes) {
  SmallBox all = boxes[0];
  for (const SmallBox& box : boxes.subspan(1))
    all = {std::min(all.x0, box.x0), std::min(all.y0, box.y0), std::max(all.x1, box.x1),
           std::max(all.y1, box.y1)};
  return all;
}

}  // namespace

template <class Weight>
KernelBlocks::KernelBlocks(const TiledTransfer<Weight>& transfer) : first_(1, 0) {
  for (int at = 0; at < transfer.tiles(); ++at)
    first_.push_back(first_.back() + (transfer.tile(at).support.size() + block_kernels - 1) / block_kernels);
  bounds_.resize(first_.back());
  tbb::parallel_for(0, transfer.tiles(), [&](int at) {
    std::span<const SmallBox> left = transfer.tile(at).support;
    for (std::size_t i = first_[static_cast<std::size_t>(at)]; !left.empty(); ++i) {
      const std::size_t count = std::min(block_kernels, left.size());
      bounds_[i] = bounds_of(left.first(count));
      left = left.subspan(count);
    }
  });
}

template KernelBlocks::KernelBlocks(const TiledTransfer<std::uint8_t>&);
template KernelBlocks::KernelBlocks(const TiledTransfer<std::uint16_t>&);

namespace {

/// Touched kernels lie all over a tile's lists when they are more than one in that many.
constexpr std::size_t much_touched = 32;

/// The change's part in one tile.
template <class Weight>
struct TouchedTile {
  Tile<Weight> tile;
  std::vector<std::int64_t> kernels;
  std::vector<SmallBox> parts;  // of these kernels, inside the change
  TouchedWeights weights;
};

/// Asks for what the weights and the pixels of a touched tile need.
template <class Weight>
void prefetch_touched(const TouchedTile<Weight>& touched, const PixelTarget& image, int x0, int y0) {
  const auto ask_for = [](const auto* first, std::size_t count) {
    const auto* begin = reinterpret_cast<const std::byte*>(first);
    const std::byte* last = reinterpret_cast<const std::byte*>(first + count) - 1;
    for (const std::byte* line = begin; line < last; line += cache_line_bytes) __builtin_prefetch(line);
    __builtin_prefetch(last);
  };
  for (const auto& dense : touched.weights.dense) {
    ask_for(touched.tile.record_weight.data() + std::size_t{dense.record} * touched.tile.record_size(),
            touched.tile.record_size());
    __builtin_prefetch(touched.tile.record_scale.data() + dense.record);
  }
  for (const auto& sparse : touched.weights.sparse) {
    ask_for(touched.tile.sparse.data() + sparse.first_use, sparse.uses);
    __builtin_prefetch(touched.tile.scale.data() + sparse.kernel);
  }
  const int columns = std::min(tile_side_px, image.width - x0),
            rows = std::min(tile_side_px, image.height - y0);
  for (int y = y0; y < y0 + rows; ++y) ask_for(image.at(x0, y), static_cast<std::size_t>(columns) * 3);
}

/// The first of ascending values that is not less than `value`, mostly near `first`: in steps of growing
/// size, so that no more memory is looked at than lies between.
template <class Iterator>
Iterator first_from(Iterator first, Iterator last, std::uint32_t value) {
  std::ptrdiff_t step = 1;
  while (step < last - first && first[step] < value) {
    first += step;
    step *= 2;
  }
  return std::lower_bound(first, first + std::min(step + 1, last - first), value);
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
      dense = first_from(dense, tile.dense_kernels.end(), kernel);
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

/// Lists the kernels under which light changed.
template <class Weight>
void find_changed(std::span<const std::int64_t> touched_blocks, const LightChange& change,
                  TouchedTile<Weight>& touched) {
  touched.kernels.clear();
  touched.parts.clear();
  for (const std::int64_t block : touched_blocks) {
    const std::size_t first = static_cast<std::size_t>(block) * KernelBlocks::block_kernels;
    const std::size_t count = std::min(KernelBlocks::block_kernels, touched.tile.support.size() - first);
    find_touched(touched.tile.support.subspan(first, count), change.within, static_cast<std::int64_t>(first),
                 touched.kernels);
  }
  std::size_t kept = 0;
  for (const std::int64_t kernel : touched.kernels) {
    const SmallBox part = overlap(touched.tile.support[static_cast<std::size_t>(kernel)], change.within);
    if (!change.changed.any(part)) continue;
    touched.kernels[kept++] = kernel;
    touched.parts.push_back(part);
  }
  touched.kernels.resize(kept);
}

/// The light of a change under the touched kernels, [kernels × 4].
template <class Weight>
void sum_change(const LightChange& change, const TouchedTile<Weight>& touched, std::vector<float>& light) {
  light.resize(std::max(light.size(), touched.parts.size() * 4));
  change.difference.sum(touched.parts, light.data());
  const std::size_t smooth = change.smooth.size() / 3;
  float* sum = light.data();
  for (const std::int64_t number : touched.kernels) {
    const auto k = static_cast<std::size_t>(number);
    if (k >= touched.tile.common.size()) break;
    if (touched.tile.common[k] < smooth)
      std::transform(change.smooth.data() + std::size_t{3} * touched.tile.common[k],
                     change.smooth.data() + std::size_t{3} * touched.tile.common[k] + 3, sum,
                     [](double channel) { return static_cast<float>(channel); });
    sum += 4;
  }
}

/// What one thread needs for a change.
template <class Weight>
struct ChangeScratch {
  TouchedTile<Weight> now, next;
  std::vector<std::int64_t> blocks;
  std::vector<float> light;
};

}  // namespace

template <class Weight>
void add_change(const TiledTransfer<Weight>& transfer, const KernelBlocks& blocks, const LightChange& change,
                const PixelTarget& image) {
  tbb::enumerable_thread_specific<ChangeScratch<Weight>> scratches;
  tbb::parallel_for(tbb::blocked_range<int>(0, transfer.tiles(), 16), [&](const auto& range) {
    ChangeScratch<Weight>& scratch = scratches.local();
    // While a tile is summed, memory brings what the next one needs: touched weights lie too far apart for
    // the processor to estimate them.
    const auto look_at = [&](int at, TouchedTile<Weight>& touched) {
      touched.tile = transfer.tile(at);
      scratch.blocks.clear();
      find_touched(blocks.of(at), change.within, 0, scratch.blocks);
      find_changed(scratch.blocks, change, touched);
      // Where much is touched, so it is in the next tile, and its lists are needed all over.
      if (much_touched * touched.kernels.size() > touched.tile.support.size())
        transfer.prefetch_for_change(at + 1);
      if (touched.kernels.empty()) return;
      list_weights(touched);
      prefetch_touched(touched, image, at % transfer.tiles_across() * tile_side_px,
                       at / transfer.tiles_across() * tile_side_px);
    };
    look_at(range.begin(), scratch.next);
    for (int at = range.begin(); at < range.end(); ++at) {
      std::swap(scratch.now, scratch.next);
      if (at + 1 < range.end()) look_at(at + 1, scratch.next);
      if (scratch.now.kernels.empty()) continue;
      sum_change(change, scratch.now, scratch.light);
      TileSums sums;
      const std::uint32_t groups =
          sum_touched(scratch.now.tile, scratch.now.weights, scratch.light.data(), sums);
      store_tile(sums, groups, true, at % transfer.tiles_across() * tile_side_px,
                 at / transfer.tiles_across() * tile_side_px, image);
    }
  });
}

template void add_change(const TiledTransfer<std::uint8_t>&, const KernelBlocks&, const LightChange&,
                         const PixelTarget&);
template void add_change(const TiledTransfer<std::uint16_t>&, const KernelBlocks&, const LightChange&,
                         const PixelTarget&);

void store_tile(const TileSums& sums, std::uint32_t groups, bool add, int x0, int y0,
                const PixelTarget& image) {
  const int columns = std::min(tile_side_px, image.width - x0);
  const int rows = std::min(tile_side_px, image.height - y0);
  if (columns == tile_side_px && rows == tile_side_px && !image.mixing) {
    store_groups(sums, groups, add, image.at(x0, y0), static_cast<std::size_t>(image.width) * 3);
    return;
  }
  float whole[tile_pixels * 3];
  store_groups(sums, all_groups, false, whole, tile_side_px * 3);
  if (image.mixing) convert_colours(whole, *image.mixing);
  for (int y = 0; y < rows; ++y)
    for (int i = 0; i < columns * 3; ++i) {
      float& value = image.at(x0, y0 + y)[i];
      value = whole[y * tile_side_px * 3 + i] + (add ? value : 0.0f);
    }
}

void DoubleTable::sum(std::span<const SmallBox> boxes, float* sums) const {
  for (const SmallBox& box : boxes) {
    const auto sum = table_.sum({box.x0, box.y0, box.x1, box.y1});
    std::ranges::transform(sum, sums, [](double channel) { return static_cast<float>(channel); });
    sums += 4;
  }
}

template <class Weight>
void multiply(const TiledTransfer<Weight>& transfer, const Coefficients& common, const BoxSums& box_sums,
              const PixelTarget& image) {
  tbb::enumerable_thread_specific<std::vector<float>> scratches;
  tbb::parallel_for(0, transfer.tiles(), [&](int at) {
    const Tile<Weight> tile = transfer.tile(at);
    std::vector<float>& light = scratches.local();  // [kernels × 4], and the dense ones' again
    light.resize(std::max(light.size(), (tile.support.size() + tile.dense_kernels.size()) * 4));
    const std::size_t shared = tile.common.size();
    for (std::size_t k = 0; k < shared; ++k)
      std::memcpy(light.data() + 4 * k, common.data() + std::size_t{3} * tile.common[k], 4 * sizeof(float));
    box_sums.sum_own(at, tile.support.subspan(shared), light.data() + 4 * shared);
    TileSums sums;
    sum_kernels(tile, light.data(), light.data() + 4 * tile.support.size(),
                transfer.tile(std::min(at + 1, transfer.tiles() - 1)), sums);
    store_tile(sums, all_groups, false, at % transfer.tiles_across() * tile_side_px,
               at / transfer.tiles_across() * tile_side_px, image);
  });
}

template void multiply(const TiledTransfer<std::uint8_t>&, const Coefficients&, const BoxSums&,
                       const PixelTarget&);
template void multiply(const TiledTransfer<std::uint16_t>&, const Coefficients&, const BoxSums&,
                       const PixelTarget&);

}  // namespace refield
