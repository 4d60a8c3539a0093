// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <variant>

#include "core/base/aligned_memory.h"
#include "core/field/light_basis.h"

namespace refield {

/// A light transfer matrix laid out for relighting: the image in square tiles, each with all that its pixels
/// need, so that a tile's sums of light and its pixels stay in the first-level cache while weights stream
/// past once. Weights are whole numbers of 8 or 16 bits times a scale.
///
/// A tile's kernels are of two sorts. `common` ones occur in several tiles: their light is summed once for
/// all. The others are this tile's own: their light is summed here, and never goes through memory. Weights
/// stand in one of two forms: dense, a weight for each of the 16 pixels of a group of 4×4, where enough of
/// them have one; else sparse, pixel by pixel.
inline constexpr int tile_side_px = 16;
inline constexpr int group_side_px = 4;
inline constexpr int group_pixels = group_side_px * group_side_px;
inline constexpr int groups_of_tile = (tile_side_px / group_side_px) * (tile_side_px / group_side_px);
inline constexpr int tile_pixels = tile_side_px * tile_side_px;

/// Where pixel number `pixel` of a tile lies in it. Groups are numbered row by row, in each the pixels row by
/// row, so that the pixels of a group are neighbours in the numbering, too.
constexpr int column_of_tile(std::size_t pixel) {
  const int group = static_cast<int>(pixel) / group_pixels, within = static_cast<int>(pixel) % group_pixels;
  return group % (tile_side_px / group_side_px) * group_side_px + within % group_side_px;
}
constexpr int row_of_tile(std::size_t pixel) {
  const int group = static_cast<int>(pixel) / group_pixels, within = static_cast<int>(pixel) % group_pixels;
  return group / (tile_side_px / group_side_px) * group_side_px + within / group_side_px;
}

/// A kernel's support in 8 bytes. Light maps are at most 32 767 texels wide or high.
struct SmallBox {
  std::int16_t x0 = 0, y0 = 0, x1 = 0, y1 = 0;
};
inline constexpr int small_box_limit = 32767;

/// Tiles begin at multiples of this.
inline constexpr std::size_t cache_line_bytes = 64;

/// One weight a channel, of one pixel of a tile.
template <class Weight>
struct SparseWeights {
  Weight channel[3] = {0, 0, 0};
  Weight pixel = 0;
};

/// Successive kernels that as many pixels have in sparse form.
struct KernelRun {
  std::uint32_t kernels = 0;
  std::uint32_t uses = 0;
};

/// What a tile's pixels need. `Array` is a span where it lies among the other tiles, a vector while the
/// tile is made.
template <class Weight, template <class> class Array>
struct TileArrays {
  Array<SmallBox> support;             ///< [kernels]: the common ones first
  Array<std::uint32_t> dense_kernels;  ///< that have dense weights, ascending
  Array<std::uint32_t> dense_start;    ///< [dense kernels + 1], of each in places
  Array<std::uint32_t> places;         ///< [dense records], record · groups_of_tile + group, by kernel
  Array<KernelRun> runs;               ///< cover all kernels, in order

  Array<std::uint32_t> group;           ///< [groups + 1], first of each group's dense records
  Array<std::uint32_t> record_kernel;   ///< [dense records], place in dense_kernels
  Array<std::uint32_t> common;          ///< [common kernels], place in TiledTransfer::common
  Array<float> scale;                   ///< [kernels], of the sparse weights
  Array<SparseWeights<Weight>> sparse;  ///< kernel by kernel
  Array<float> record_scale;            ///< [records]
  /// [records × channels × group_pixels]: one channel in a grey tile, whose pixels weigh all three alike.
  Array<Weight> record_weight;

  bool is_grey() const { return record_weight.size() == record_kernel.size() * group_pixels; }
  /// Weights of a record.
  std::size_t record_size() const { return std::size_t{is_grey() ? 1u : 3u} * group_pixels; }
};

template <class T>
using ConstSpan = std::span<const T>;
template <class T>
using Vector = std::vector<T>;

template <class Weight>
using Tile = TileArrays<Weight, ConstSpan>;

template <class Weight>
struct TiledTransfer {
  int width = 0;
  int height = 0;
  std::vector<std::uint32_t> common;  ///< [common kernels], number in the field's basis; hats come first
  /// Some rows of tiles. Each tile is one piece of `memory` that begins at a cache line: the lengths of its
  /// arrays, then the arrays.
  struct Band {
    std::vector<std::byte, AlignedAllocator<std::byte>> memory;
    std::vector<std::uint32_t> start;         ///< [tiles + 1], in `memory`
    std::vector<std::uint32_t> change_until;  ///< [tiles], bytes of a tile that a change of light looks at
  };
  static constexpr int band_rows = 4;
  std::vector<Band> bands;

  int tiles_across() const { return (width + tile_side_px - 1) / tile_side_px; }
  int tiles_down() const { return (height + tile_side_px - 1) / tile_side_px; }
  int tiles() const { return tiles_across() * tiles_down(); }
  Tile<Weight> tile(int at) const;
  /// Prefetches what a change of light looks at in a tile: its arrays are too short for the processor to
  /// prefetch them. What all light needs is prefetched by sum_kernels().
  void prefetch_for_change(int at) const;
  std::size_t bytes() const;
  /// Fills in where the parts of each tile end, when the rest of all bands stands.
  void mark_parts();
  /// Bytes that a tile takes by the lengths that it states; may be more than it has where these are wrong.
  std::uint64_t bytes_stated(int at) const;

 private:
  const std::byte* begin_of(int at) const;
};

/// Calls visit(array) for each of a tile's arrays, always in the order in which they lie in memory
/// and in files of packed fields.
template <class Arrays, class Visit>
void for_each_array(Arrays& arrays, const Visit& visit) {
  visit(arrays.dense_start);
  visit(arrays.places);
  visit(arrays.support);
  visit(arrays.dense_kernels);
  visit(arrays.runs);
  visit(arrays.group);
  visit(arrays.record_kernel);
  visit(arrays.common);
  visit(arrays.scale);
  visit(arrays.sparse);
  visit(arrays.record_scale);
  visit(arrays.record_weight);
}

/// Calls visit(kernel of the tile, pixel of the tile, weights of the three channels) for all weights of a
/// tile that are not zero.
template <class Weight, class Visit>
void for_each_weight(const Tile<Weight>& tile, const Visit& visit) {
  const auto visit_some = [&](std::size_t kernel, std::size_t pixel, const Weight* weight, std::size_t apart,
                              float scale) {
    if (weight[0] == 0 && weight[apart] == 0 && weight[2 * apart] == 0) return;
    visit(kernel, pixel,
          std::array{scale * static_cast<float>(weight[0]), scale * static_cast<float>(weight[apart]),
                     scale * static_cast<float>(weight[2 * apart])});
  };
  std::size_t kernel = 0;
  const SparseWeights<Weight>* uses = tile.sparse.data();
  for (const KernelRun& run : tile.runs)
    for (std::uint32_t k = 0; k < run.kernels; ++k, ++kernel)
      for (std::uint32_t i = 0; i < run.uses; ++i, ++uses)
        visit_some(kernel, uses->pixel, uses->channel, 1, tile.scale[kernel]);
  for (std::size_t g = 0; g < groups_of_tile; ++g)
    for (std::size_t r = tile.group[g]; r < tile.group[g + 1]; ++r)
      for (std::size_t i = 0; i < group_pixels; ++i)
        visit_some(tile.dense_kernels[tile.record_kernel[r]], g * group_pixels + i,
                   tile.record_weight.data() + r * tile.record_size() + i, tile.is_grey() ? 0 : group_pixels,
                   tile.record_scale[r]);
}

/// Appends a tile to a piece of memory.
template <class Weight>
void append_tile(const TileArrays<Weight, Vector>& tile, std::vector<std::byte>& memory);
extern template void append_tile(const TileArrays<std::uint8_t, Vector>&, std::vector<std::byte>&);
extern template void append_tile(const TileArrays<std::uint16_t, Vector>&, std::vector<std::byte>&);

extern template struct TiledTransfer<std::uint8_t>;
extern template struct TiledTransfer<std::uint16_t>;

using TransferTiles = std::variant<TiledTransfer<std::uint8_t>, TiledTransfer<std::uint16_t>>;

}  // namespace refield
