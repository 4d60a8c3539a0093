// SPDX-License-Identifier: Apache-2.0
#include "estimate/kernel_cache.h"

#include <algorithm>

namespace refield {

std::vector<int> split_positions(int begin, int end, EstimateMode mode) {
  const int length = end - begin;
  std::vector<int> positions = {begin + length / 2};
  // Measured on prototypes (same images and kernels): thirds and halves leave a third of the error of halves
  // alone; quarters or eighths are no better than thirds.
  if (mode == EstimateMode::refined) {
    positions.push_back(begin + (length + 1) / 3);
    positions.push_back(begin + (2 * length + 1) / 3);
  }
  std::ranges::sort(positions);
  positions.erase(std::unique(positions.begin(), positions.end()), positions.end());
  std::erase_if(positions, [&](int p) { return p <= begin || p >= end; });
  return positions;
}

float* KernelCache::make_column(const Box& box, int channel) {
  const std::size_t extent = smooth_.extent();
  const std::size_t block_size = std::max(block_floats, extent);
  if (blocks_.empty() || blocks_.back().used + extent > block_size)
    blocks_.push_back({AlignedFloats(block_size)});
  Block& block = blocks_.back();
  float* column = block.memory.data() + block.used;
  block.used += extent;
  table_.channel_column(box, channel, column);
  smooth_.extend(column, channel);
  return column;
}

void KernelCache::clear() {
  columns_.clear();
  splits_.clear();
  blocks_.clear();
}

const float* KernelCache::column(const Box& box, int channel) {
  const float*& slot = columns_[box][channel];
  if (!slot) slot = make_column(box, channel);
  return slot;
}

std::array<const float*, 3> KernelCache::column(const Box& box) {
  return {column(box, 0), column(box, 1), column(box, 2)};
}

void KernelCache::make(Split& split, int channel) {
  if (split.direction[channel]) return;
  const float* p = column(split.parent(), channel);
  float* d = make_column(split.first, channel);
  const std::size_t stride = table_.stride();
  const float* others[2] = {d, p};
  float with_parent[2];
  dots(p, others, 2, stride, with_parent);
  split.fraction[channel] = with_parent[1] > 0.0f ? with_parent[0] / with_parent[1] : 0.0f;
  subtract_combination(d, &p, &split.fraction[channel], 1, smooth_.extent());
  const float* self = d;
  dots(d, &self, 1, stride, &split.norm2[channel]);
  split.direction[channel] = d;
}

std::span<Split> KernelCache::splits(const Box& box) {
  const auto [entry, is_new] = splits_.try_emplace(box);
  if (is_new) {
    for (const int x : split_positions(box.x0, box.x1, mode_))
      entry->second.push_back({{box.x0, box.y0, x, box.y1}, {x, box.y0, box.x1, box.y1}});
    for (const int y : split_positions(box.y0, box.y1, mode_))
      entry->second.push_back({{box.x0, box.y0, box.x1, y}, {box.x0, y, box.x1, box.y1}});
  }
  return entry->second;
}

}  // namespace refield
