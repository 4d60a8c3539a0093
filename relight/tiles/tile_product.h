// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/aligned_memory.h"
#include "core/field/transfer_tiles.h"
#include "core/image/image.h"
#include "core/light/light_map.h"
#include "relight/tiles/box_sums.h"
#include "relight/tiles/tile_vectors.h"
#include "relight/tiles/tiled_transfer.h"

namespace refield {

/// Where pixels go: [height × width × 3] floats without gaps, which another user owns. Each is multiplied by
/// `mixing` (FieldOutline::output_from_primaries) where that is not null.
struct PixelTarget {
  float* values = nullptr;
  int width = 0;
  int height = 0;
  const Eigen::Matrix3f* mixing = nullptr;

  PixelTarget(float* first, int width_px, int height_px, const Eigen::Matrix3f* by = nullptr)
      : values(first), width(width_px), height(height_px), mixing(by) {}
  PixelTarget(Image& image)  // NOLINT(google-explicit-constructor): wherever pixels go
      : PixelTarget(image.values.data(), image.width, image.height) {}
  float* at(int x, int y) const { return values + (static_cast<std::size_t>(y) * width + x) * 3; }
};

/// Light under kernels, three floats each, and one more, so that each can be read as four.
using Coefficients = AlignedFloats;

/// image [height × width × 3] = transfer · light. `common` [common kernels × 3 + 1]: their coefficients; the
/// others' light is `light`'s. Runs on all cores; each output is
/// summed in a fixed order.
template <class Weight>
void multiply(const TiledTransfer<Weight>& transfer, const Coefficients& common, const BoxSums& light,
              const PixelTarget& image);

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

/// Writes a tile's `groups` (a bit each) into the image at (x0, y0), or, with `add`, adds them; what lies
/// beyond the image's edges is left out.
void store_tile(const TileSums& sums, std::uint32_t groups, bool add, int x0, int y0,
                const PixelTarget& image);

}  // namespace refield
