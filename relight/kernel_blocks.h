// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "core/transfer_tiles.h"

namespace refield {

/// Bounds of successive kernels of each tile. Kernels that lie next to each other on the light map mostly do
/// so in their tile, too, so a look at these bounds, an eighth of a byte a kernel, finds the few that a
/// change of light may touch.
class KernelBlocks {
 public:
  static constexpr std::size_t block_kernels = 64;

  KernelBlocks() = default;  ///< of no tiles
  /// Runs on all cores.
  template <class Weight>
  explicit KernelBlocks(const TiledTransfer<Weight>& transfer);

  bool empty() const { return first_.empty(); }
  /// [blocks of the tile]: what covers the supports of its kernels [64 i, 64 i + 64).
  std::span<const SmallBox> of(int tile) const {
    const auto at = static_cast<std::size_t>(tile);
    return std::span(bounds_).subspan(first_[at], first_[at + 1] - first_[at]);
  }

 private:
  std::vector<SmallBox> bounds_;
  std::vector<std::size_t> first_;  // [tiles + 1], in bounds_
};

extern template KernelBlocks::KernelBlocks(const TiledTransfer<std::uint8_t>&);
extern template KernelBlocks::KernelBlocks(const TiledTransfer<std::uint16_t>&);

}  // namespace refield
