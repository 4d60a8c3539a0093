// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "bench/studies/chart/pixel_kinds.h"
#include "core/field/reflectance_field.h"
#include "core/image/metrics.h"

namespace refield::chart {

/// How a pixel's transport spreads over the light map.
struct TransportSpread {
  double half_area = 0.0;  ///< the least share of the map that gives half of the pixel's light, under white
  double dark_area = 0.0;  ///< share of the map where transport is below 5 % of its mean
  double light = 0.0;      ///< the pixel under white light of radiance 1, all channels together
};
TransportSpread transport_spread(const ReflectanceField& field, std::size_t pixel);

/// A stand-in for a map of kinds where nothing is known but a fitted field: pixels are sorted by the shape of
/// their transport, not by what the camera looks at. With the medians of the spread over 3 × 3 pixels:
/// refraction: half of the light from less than 3 % of the map; mixed: from 3 to 10 %; hard_shadow: from
/// more, and at least 15 % of the map dark; glossy: from 10 to 20 %; diffuse: from more. Pixels with less
/// than a hundredth of the median pixel's light are of no kind.
PixelKinds derived_kinds(const ReflectanceField& field, const Mask& mask);

}  // namespace refield::chart
