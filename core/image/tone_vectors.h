// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstddef>
#include <cstdint>

namespace refield {

/// A LevelTable's contents, see there. The level of a value is that of its cell, or of up to `steps` more,
/// as many as the value reaches.
struct LevelCells {
  const std::uint8_t* level_at_start;  ///< three bytes more may be read behind the last
  const float* least_value_of;         ///< [257]
  int shift;                           ///< of a value's bits, to its cell
  int steps;
};

/// Three-channel pixels [pixels × 3] to red, green, blue and 255 [pixels × 4]. Values that are negative or no
/// number become those of 0.
void tone_map_pixels(const LevelCells& cells, const float* values, std::size_t pixels, std::uint8_t* rgba);

}  // namespace refield
