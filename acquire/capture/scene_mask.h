// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/image/metrics.h"

namespace refield {

/// Finds the pixels that show something of interest (Matusik et al. 2004, section 6: "simple background
/// subtraction"). `white`: the scene under the monitor's full white, ambient light subtracted. Without
/// `background`, a pixel belongs to the scene when it responds to the monitor at all; with `background`, the
/// same photograph with the objects taken away, when it differs from that. Any channel suffices; clipped
/// samples count as a response. The result is cleaned by morphological opening, then closing. Throws
/// InputError when the sizes differ or nothing responds.
Mask scene_mask(const Photograph& white, const Photograph* background = nullptr);

/// Writes a mask as a PNG, white where the scene is: what read_mask() reads.
void write_mask(const fs::path& path, const Mask& mask, int width, int height);

}  // namespace refield
