// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/light/light_map.h"
#include "relight/tiles/tiled_transfer.h"

/// The inner loops of relighting, vectorised for the instruction set found at run time.
namespace refield {

/// What a tile's pixels gather, before it goes to the image: single weights pixel by pixel, dense ones
/// channel by channel.
struct alignas(64) TileSums {
  float sparse[tile_pixels * 4];
  float dense[groups_of_tile * 3 * group_pixels];
  bool has_sparse;  ///< otherwise `sparse` means nothing
};

/// The weights of those kernels of a tile that a change of light touches. They are found before they are
/// needed, so that memory can be asked for them.
struct TouchedWeights {
  struct Dense {
    std::uint32_t record, group, light;
  };
  struct Sparse {
    std::uint32_t first_use, uses, kernel, light;
  };
  std::vector<Dense> dense;
  std::vector<Sparse> sparse;
};

/// Sums of texels under boxes, [count × 4] with the fourth meaning nothing, through a table of whole numbers
/// ([FixedPointTable]).
void sum_boxes_fixed(const std::int32_t* corners, std::int32_t stride, const float* step,
                     const SmallBox* boxes, std::size_t count, float* sums);

/// Sums all kernels of a tile; `light` [kernels × 4]; `dense_light`: room for [dense kernels × 4].
/// Prefetches on the way what all light needs of the tile that comes `next`, and the lengths behind it.
void sum_kernels(const Tile<std::uint8_t>& tile, const float* light, float* dense_light,
                 const Tile<std::uint8_t>& next, TileSums& sums);
void sum_kernels(const Tile<std::uint16_t>& tile, const float* light, float* dense_light,
                 const Tile<std::uint16_t>& next, TileSums& sums);
/// Sums what is touched; `light` [touched kernels × 4]. Returns the groups of pixels that any of it reaches,
/// a bit each; the others are zero.
std::uint32_t sum_touched(const Tile<std::uint8_t>& tile, const TouchedWeights& touched, const float* light,
                          TileSums& sums);
std::uint32_t sum_touched(const Tile<std::uint16_t>& tile, const TouchedWeights& touched, const float* light,
                          TileSums& sums);

/// Appends the numbers of the boxes that overlap `within`, ascending; the first box is number `first`.
void find_touched(std::span<const SmallBox> boxes, const Box& within, std::int64_t first,
                  std::vector<std::int64_t>& touched);

inline constexpr std::uint32_t all_groups = (1u << groups_of_tile) - 1;

/// Writes groups of a tile of 16×16 pixels (its first at `pixels`, rows `row_floats` apart) or, with `add`,
/// adds them.
void store_groups(const TileSums& sums, std::uint32_t groups, bool add, float* pixels,
                  std::size_t row_floats);

}  // namespace refield
