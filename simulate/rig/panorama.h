// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>

#include "core/image/image.h"
#include "core/light/euler_angles.h"
#include "core/light/light_map.h"

namespace refield {

/// A made-up surrounding, lat-long, linear radiance, sun and area lights far above 1: sky or ceiling,
/// horizon, buildings or walls, area lights and windows, and over all a dead-leaves pattern (Lee, Mumford and
/// Huang 2001): opaque shapes that cover one another, with sizes r distributed as r^-3. That gives what
/// estimation lives on, the statistics of natural images: sharp edges at all scales, heavy-tailed gradients,
/// a power spectrum that falls about as 1/f². `width` must be even; the height is half of it. Equal arguments
/// give equal panoramas.
Image make_panorama(std::uint64_t seed, std::uint64_t index, int width);

/// How someone looks into a panorama.
struct PanoramaView {
  EulerAngles turn{};  ///< of the one who looks
  double horizontal_fov_degrees = 70.0;
};

/// A perspective view, as a monitor shows it; four samples per texel. Radiance as in the panorama.
Image view_of_panorama(const Image& panorama, const PanoramaView& view, int width, int height);

}  // namespace refield
