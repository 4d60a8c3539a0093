// SPDX-License-Identifier: Apache-2.0
#include "relight/kernel_blocks.h"

#include <tbb/parallel_for.h>

#include <algorithm>

namespace refield {

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

}  // namespace refield
