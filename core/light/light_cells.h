// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace refield {

/// Most light cells (light sources, or blocks of a coarse display) that estimation gives a weight each. Time
/// per pixel and memory grow with the square of their number. Photographs of one cell at a time need no
/// choice of a prior for complete pixels, so that their limit is higher: docs/method/light-stages.md.
inline constexpr int max_light_cells = 256;
inline constexpr int max_single_light_cells = 512;

}  // namespace refield
