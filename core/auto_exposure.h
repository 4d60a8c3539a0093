// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/image.h"
#include "core/metrics.h"

namespace refield {

/// The exposure at which the 99th percentile of the brightest channel inside the mask is white; 1 for a black
/// image.
double exposure_to_white(const Image& image, const Mask& mask = {});

}  // namespace refield
