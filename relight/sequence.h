// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/light_map.h"

namespace refield {

/// Frame `frame` of `frames` of a vertical bar of light that slides from left to right (Matusik et al. 2004,
/// figure 9: a white bar of 100 columns in a map of 800). `width_fraction`: of the map's width, in (0, 1].
/// Columns that the bar covers in part are lit in part, so that slow sequences move smoothly. On a monitor
/// the bar goes from edge to edge; in a lat-long map, whose edges meet, it goes once around. Throws
/// InputError for a fraction or frame out of range.
LightMap sliding_bar(const LightDomain& domain, double width_fraction, int frame, int frames,
                     float radiance = 1.0f);

/// A lat-long map turned about the vertical axis by `turns` (1 = full circle), content moving to the right;
/// columns are interpolated linearly. Throws InputError for another parameterisation.
LightMap rotated(const LightMap& light, double turns);

/// Light `a` that fades to light `b`: (1 − share) · a + share · b. Throws InputError unless they are maps of
/// one size and parameterisation.
LightMap mixed(const LightMap& a, const LightMap& b, double share);

}  // namespace refield
