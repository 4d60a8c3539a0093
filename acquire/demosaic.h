// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "acquire/camera.h"
#include "core/image_io.h"

namespace refield {

/// Interpolates a plane of Bayer samples to RGB, bilinearly, by masked filtering; at the border by what
/// samples there are. Measured samples stay as they are. Sigma follows the filter's weights; that
/// neighbouring interpolated pixels then share their noise is not recorded. A pixel that rests on any clipped
/// sample (infinite sigma) has infinite sigma: brighter neighbours left out would make it too dark. Both
/// planes are [height × width × 1], the layout is a Bayer one; throws InputError otherwise or below 2×2
/// pixels.
Photograph demosaic(const Image& radiance, const Image& sigma, PixelLayout layout);

}  // namespace refield
