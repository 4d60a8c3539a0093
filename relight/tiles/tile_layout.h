// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <limits>
#include <vector>

#include "relight/tiles/tiled_transfer.h"

/// How tile_transfer() turns rows of a transfer into tiles.
namespace refield {

inline constexpr std::uint32_t not_common = std::numeric_limits<std::uint32_t>::max();

/// Finds the kernels that several tiles have. Hats all count as such.
class CommonKernels {
 public:
  explicit CommonKernels(const LightBasis& basis) : basis_(basis), owner_(basis.size(), 0) {}

  /// Looks at rows of the picture, from its tile row `first_tile_row` on. Runs on all cores.
  void add(const ReflectanceField& rows, int first_tile_row);
  /// [basis functions]: place among the common kernels, listed in `common`, or not_common.
  std::vector<std::uint32_t> places(std::vector<std::uint32_t>& common) const;

 private:
  const LightBasis& basis_;
  std::vector<std::uint32_t> owner_;  // [basis functions]: 0, the only tile that has it + 1, or `several`
};

/// What one thread needs to lay out one tile after another.
struct TileWorkshop {
  /// A kernel of the tile at hand.
  struct Kernel {
    std::uint32_t number = 0;  // in the basis
    std::uint32_t key = 0;     // in `place`
    bool negative = false;     // its scales are
    bool own = false;
    bool repeated = false;  // a pixel has it more than once
    std::uint32_t last_pixel = not_common;
    std::uint32_t uses = 0;  // in sparse form
    Box support;
    std::uint32_t on_map = 0;                    // where it lies, for the order of kernels
    std::uint32_t entries[groups_of_tile] = {};  // of each group
    std::uint32_t record[groups_of_tile] = {};   // of its dense weights, where a group has them
    float largest = 0.0f;                        // of its sparse weights
    std::uint32_t next_sparse = 0;
    bool dense(int group) const;
  };
  /// [2 × basis functions], of a kernel in `kernels`: of the positive weights of each, then of the negative.
  std::vector<std::uint32_t> place;
  std::vector<Kernel> kernels;       // by first appearance
  std::vector<std::uint32_t> order;  // of the tile's kernels, in `kernels`
};

/// Lays out tile (tile_x, tile_y). Whole numbers have no sign: a kernel's negative weights are those of a
/// second kernel of the same support whose scale is negative.
template <class Weight>
TileArrays<Weight, Vector> lay_out_tile(const ReflectanceField& field,
                                        const std::vector<std::uint32_t>& common_place, int tile_x,
                                        int tile_y, TileWorkshop& workshop);

extern template TileArrays<std::uint8_t, Vector> lay_out_tile(const ReflectanceField&,
                                                              const std::vector<std::uint32_t>&, int, int,
                                                              TileWorkshop&);
extern template TileArrays<std::uint16_t, Vector> lay_out_tile(const ReflectanceField&,
                                                               const std::vector<std::uint32_t>&, int, int,
                                                               TileWorkshop&);

}  // namespace refield
