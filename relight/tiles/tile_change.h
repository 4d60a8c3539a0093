// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/field/transfer_tiles.h"
#include "core/image/image.h"
#include "core/light/light_map.h"
#include "relight/tiles/tile_product.h"
#include "relight/tiles/tiled_transfer.h"

namespace refield {

/// Which texels a change of light changed: an area light that moves leaves most of what it lit as it was.
class ChangedTexels {
 public:
  /// `difference`: new less old light, 3 channels; memory is kept from one to the next.
  void build(const Image& difference);

  /// Whether any texel in `box` changed; it must lie inside the difference.
  bool any(const SmallBox& box) const {
    if (counts_.empty()) return true;
    return counts_[place(box.x1, box.y1)] - counts_[place(box.x0, box.y1)] !=
           counts_[place(box.x1, box.y0)] - counts_[place(box.x0, box.y0)];
  }

 private:
  std::size_t place(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width_ + 1) + static_cast<std::size_t>(x);
  }
  int width_ = 0;
  std::vector<std::int32_t>
      counts_;  // summed-area table [(height + 1) × (width + 1)]; empty where all changed
};

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

/// A light that changed inside one rectangle.
struct LightChange {
  Box within;
  const ChangedTexels& changed;   ///< inside `within`
  const BoxSumTable& difference;  ///< new less old radiance there
  std::vector<double> smooth;     ///< [smooth kernels × 3], what the change adds to their coefficients
};

/// image += transfer · change. Of kernels that the change does not reach nothing is looked at but the bounds
/// of their blocks (`blocks`, of this transfer), and weights only of kernels under which texels changed.
template <class Weight>
void add_change(const TiledTransfer<Weight>& transfer, const KernelBlocks& blocks, const LightChange& change,
                const PixelTarget& image);

}  // namespace refield
