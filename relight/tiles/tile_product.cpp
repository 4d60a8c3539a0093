// SPDX-License-Identifier: Apache-2.0
#include "relight/tiles/tile_product.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstring>

#include "core/image/colour.h"

namespace refield {

void store_tile(const TileSums& sums, std::uint32_t groups, bool add, int x0, int y0,
                const PixelTarget& image) {
  const int columns = std::min(tile_side_px, image.width - x0);
  const int rows = std::min(tile_side_px, image.height - y0);
  if (columns == tile_side_px && rows == tile_side_px && !image.mixing) {
    store_groups(sums, groups, add, image.at(x0, y0), static_cast<std::size_t>(image.width) * 3);
    return;
  }
  float whole[tile_pixels * 3];
  store_groups(sums, all_groups, false, whole, tile_side_px * 3);
  if (image.mixing) convert_colours(whole, *image.mixing);
  for (int y = 0; y < rows; ++y)
    for (int i = 0; i < columns * 3; ++i) {
      float& value = image.at(x0, y0 + y)[i];
      value = whole[y * tile_side_px * 3 + i] + (add ? value : 0.0f);
    }
}

void DoubleTable::sum(std::span<const SmallBox> boxes, float* sums) const {
  for (const SmallBox& box : boxes) {
    const auto sum = table_.sum({box.x0, box.y0, box.x1, box.y1});
    std::ranges::transform(sum, sums, [](double channel) { return static_cast<float>(channel); });
    sums += 4;
  }
}

template <class Weight>
void multiply(const TiledTransfer<Weight>& transfer, const Coefficients& common, const BoxSums& box_sums,
              const PixelTarget& image) {
  tbb::enumerable_thread_specific<std::vector<float>> scratches;
  tbb::parallel_for(0, transfer.tiles(), [&](int at) {
    const Tile<Weight> tile = transfer.tile(at);
    std::vector<float>& light = scratches.local();  // [kernels × 4], and the dense ones' again
    light.resize(std::max(light.size(), (tile.support.size() + tile.dense_kernels.size()) * 4));
    const std::size_t shared = tile.common.size();
    for (std::size_t k = 0; k < shared; ++k)
      std::memcpy(light.data() + 4 * k, common.data() + std::size_t{3} * tile.common[k], 4 * sizeof(float));
    box_sums.sum_own(at, tile.support.subspan(shared), light.data() + 4 * shared);
    TileSums sums;
    sum_kernels(tile, light.data(), light.data() + 4 * tile.support.size(),
                transfer.tile(std::min(at + 1, transfer.tiles() - 1)), sums);
    store_tile(sums, all_groups, false, at % transfer.tiles_across() * tile_side_px,
               at / transfer.tiles_across() * tile_side_px, image);
  });
}

template void multiply(const TiledTransfer<std::uint8_t>&, const Coefficients&, const BoxSums&,
                       const PixelTarget&);
template void multiply(const TiledTransfer<std::uint16_t>&, const Coefficients&, const BoxSums&,
                       const PixelTarget&);

}  // namespace refield
