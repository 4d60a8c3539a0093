// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/image/image.h"
#include "core/image/tone_map.h"

namespace refield {

/// sRGB-encoded red, green, blue in [0, 1].
using EncodedColour = std::array<float, 3>;

/// Black, violet, red, orange, pale yellow, evenly spaced; lightness rises steadily, so that the picture also
/// reads in grey print.
inline constexpr std::array<EncodedColour, 7> false_colour_stops = {{{0.00f, 0.00f, 0.02f},
                                                                     {0.18f, 0.06f, 0.37f},
                                                                     {0.47f, 0.11f, 0.43f},
                                                                     {0.76f, 0.20f, 0.33f},
                                                                     {0.93f, 0.41f, 0.15f},
                                                                     {0.98f, 0.71f, 0.10f},
                                                                     {0.99f, 1.00f, 0.75f}}};

/// The colour of 0 … 1, linear between the stops (of encoded values); outside it the nearer end's.
EncodedColour false_colour(double fraction);

/// Levels of values from 0 to `high`, evenly.
LevelTable linear_levels(double high);
/// Levels of values from 2^low to 2^high, evenly in stops; 0 and less are the lowest level.
LevelTable stop_levels(double low, double high);

/// A map of one channel, or the luminance (Rec. 709) of three, coloured by its level into pixels of red,
/// green, blue and 255. NaN is a flat grey. `rgba` [pixels × 4]. On all cores.
void false_colour_rgba(const Image& image, const LevelTable& levels, std::span<std::uint8_t> rgba);

}  // namespace refield
