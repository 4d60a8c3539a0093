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

float* KernelCache::make_column(const Box& box) {
  const std::size_t extent = smooth_.extent();
  const std::size_t size = 3 * extent;
  const std::size_t block_size = std::max(block_floats, size);
  if (blocks_.empty() || blocks_.back().used + size > block_size)
    blocks_.push_back({AlignedFloats(block_size)});
  Block& block = blocks_.back();
  float* column = block.memory.data() + block.used;
  block.used += size;
  table_.column(box, column, extent);
  for (int c = 0; c < 3; ++c) smooth_.extend(column + c * extent, c);
  return column;
}

void KernelCache::clear() {
  columns_.clear();
  splits_.clear();
  blocks_.clear();
}

const float* KernelCache::column(const Box& box) {
  const float*& slot = columns_[box];
  if (!slot) slot = make_column(box);
  return slot;
}

void KernelCache::add_split(const Box& box, const float* parent, int axis, int position,
                            std::vector<Split>& splits) {
  Split split{box, box};
  (axis == 0 ? split.first.x1 : split.first.y1) = position;
  (axis == 0 ? split.second.x0 : split.second.y0) = position;
  float* direction = make_column(split.first);
  const std::size_t stride = table_.stride();
  const std::size_t extent = smooth_.extent();
  for (int c = 0; c < 3; ++c) {
    const float* p = parent + c * extent;
    float* d = direction + c * extent;
    float with_parent[2];
    const float* others[2] = {d, p};
    dots(p, others, 2, stride, with_parent);
    split.fraction[c] = with_parent[1] > 0.0f ? with_parent[0] / with_parent[1] : 0.0f;
    subtract_combination(d, &p, &split.fraction[c], 1, extent);
    const float* self = d;
    dots(d, &self, 1, stride, &split.norm2[c]);
  }
  split.direction = direction;
  splits.push_back(split);
}

std::span<const Split> KernelCache::splits(const Box& box) {
  const auto [entry, is_new] = splits_.try_emplace(box);
  if (is_new) {
    const float* parent = column(box);
    for (const int x : split_positions(box.x0, box.x1, mode_)) add_split(box, parent, 0, x, entry->second);
    for (const int y : split_positions(box.y0, box.y1, mode_)) add_split(box, parent, 1, y, entry->second);
  }
  return entry->second;
}

}  // namespace refield
