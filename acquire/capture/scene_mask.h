// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>

#include "core/image/image_io.h"
#include "core/image/metrics.h"

namespace refield {

struct SceneMaskOptions {
  double noise_multiple = 5.0;   ///< a response must exceed this many standard deviations
  double least_response = 0.01;  ///< and this fraction of the brightest (99th percentile) response
  int cleaning_radius_px = 1;    ///< specks and holes up to about this size go; 0: no cleaning
};

/// Finds the pixels that show something of interest (Matusik et al. 2004, section 6: "simple background
/// subtraction"). `white`: the scene under the monitor's full white, ambient light subtracted. Without
/// `background`, a pixel belongs to the scene when it responds to the monitor at all; with `background`, the
/// same photograph with the objects taken away, when it differs from that. Any channel suffices; clipped
/// samples count as a response. The result is cleaned by morphological opening, then closing. Throws
/// InputError when the sizes differ or nothing responds.
Mask scene_mask(const Photograph& white, const Photograph* background = nullptr,
                const SceneMaskOptions& options = {});

/// Writes a mask as a PNG, white where the scene is: what read_mask() reads.
void write_mask(const std::filesystem::path& path, const Mask& mask, int width, int height);

}  // namespace refield
