// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/kernel_cache.h"

namespace refield {

std::vector<int> split_positions(int begin, int end, EstimateMode mode) {
  const int length = end - begin;
  std::vector<int> positions;
  positions.reserve(3);
  positions.push_back(begin + length / 2);
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

float* KernelCache::allocate(std::size_t floats) {
  const std::size_t block_size = std::max(block_floats, smooth_.extent());
  if (blocks_in_use_ == 0 || used_of_block_ + floats > block_size) {
    if (blocks_in_use_ == blocks_.size()) {
      const std::size_t bytes = block_size * sizeof(float);
      blocks_.emplace_back(static_cast<float*>(allocate_aligned(bytes)), FreeBlock{bytes});
    }
    ++blocks_in_use_;
    used_of_block_ = 0;
  }
  float* memory = blocks_[blocks_in_use_ - 1].get() + used_of_block_;
  used_of_block_ += floats;
  return memory;
}

void KernelCache::clear() {
  columns_.clear();
  splits_.clear();
  blocks_in_use_ = 0;
}

void KernelCache::keep_within(std::uint64_t limit_bytes) {
  if (bytes() <= limit_bytes) return;
  clear();
  const auto max_blocks = static_cast<std::size_t>(limit_bytes / (block_floats * sizeof(float)));
  if (blocks_.size() > max_blocks) blocks_.resize(max_blocks);
}

const float* KernelCache::column(const Box& box, int channel) {
  const float*& slot = columns_[box][channel];
  if (slot) return slot;
  float* column = allocate(smooth_.extent());
  table_.channel_column(box, channel, column);
  smooth_.extend(column, channel);
  return slot = column;
}

std::array<const float*, 3> KernelCache::column(const Box& box) {
  return {column(box, 0), column(box, 1), column(box, 2)};
}

void KernelCache::make(Split& split, int channel) {
  if (split.direction[channel]) return;
  const float* p = column(split.parent(), channel);
  const std::size_t stride = table_.stride();
  float* d = allocate(stride);
  table_.channel_column(split.first, channel, d);
  const float* others[2] = {d, p};
  float with_parent[2];
  dots(p, others, 2, stride, with_parent);
  split.fraction[channel] = with_parent[1] > 0.0f ? with_parent[0] / with_parent[1] : 0.0f;
  subtract_combination(d, &p, &split.fraction[channel], 1, stride);
  const float* self = d;
  dots(d, &self, 1, stride, &split.norm2[channel]);
  split.direction[channel] = d;
}

void KernelCache::prefetch(const Split& split, int channel) const {
  if (const float* d = split.direction[channel]) {
    for (std::size_t j = 0; j < table_.stride(); j += column_padding) __builtin_prefetch(d + j);
    return;
  }
  // The parent's corners were read before.
  table_.prefetch(split.second.x0, split.second.y0, channel, channel + 1);
  table_.prefetch(split.first.x1, split.first.y1, channel, channel + 1);
}

const float* KernelCache::smooth_coordinates(Split& split, int channel) {
  const float*& slot = split.smooth[channel];
  if (slot) return slot;
  float* coordinates = allocate(smooth_.extent() - smooth_.stride());
  smooth_.project(split.direction[channel], channel, coordinates);
  return slot = coordinates;
}

std::span<Split> KernelCache::splits(const Box& box) {
  const auto [entry, is_new] = splits_.try_emplace(box);
  Splits& splits = entry->second;
  if (is_new) {
    const auto add = [&](const Box& first, const Box& second) {
      Split& split = splits.ways[splits.count++];
      split.first = first;
      split.second = second;
    };
    for (const int x : split_positions(box.x0, box.x1, mode_))
      add({box.x0, box.y0, x, box.y1}, {x, box.y0, box.x1, box.y1});
    for (const int y : split_positions(box.y0, box.y1, mode_))
      add({box.x0, box.y0, box.x1, y}, {box.x0, y, box.x1, box.y1});
  }
  return {splits.ways.data(), static_cast<std::size_t>(splits.count)};
}

}  // namespace refield
