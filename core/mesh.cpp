// SPDX-License-Identifier: Apache-2.0
#include "core/mesh.h"

#include "core/transfer_tiles.h"

namespace refield {

namespace {
constexpr std::size_t tiles_across = output_image_width / tile_side_px;
}

int output_image_height(std::size_t outputs) {
  constexpr std::size_t outputs_of_a_row_of_tiles = tiles_across * tile_pixels;
  return static_cast<int>((outputs + outputs_of_a_row_of_tiles - 1) / outputs_of_a_row_of_tiles) *
         tile_side_px;
}

std::size_t pixel_of_output(std::size_t output) {
  const std::size_t tile = output / tile_pixels, within = output % tile_pixels;
  const std::size_t x = tile % tiles_across * tile_side_px + static_cast<std::size_t>(column_of_tile(within));
  const std::size_t y = tile / tiles_across * tile_side_px + static_cast<std::size_t>(row_of_tile(within));
  return y * output_image_width + x;
}

}  // namespace refield
