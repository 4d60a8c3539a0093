// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/image/image_io.h"
#include "core/image/metrics.h"

namespace refield {

/// Divides a photograph under one light source by that of a white card in the object's place under the same
/// source, and multiplies by `cos_angle`, the cosine between the source and the card's normal: radiance
/// relative to a white diffuser that faces the source. Fall-off, intensity and vignetting cancel. The card is
/// smoothed by fit_relative_map() inside `mask` (empty: all pixels); pixels outside are marked as unmeasured.
/// Throws InputError (without the file's name) where the card is of another size, or clipped or dark inside
/// the mask, or behind the light source.
void divide_by_card(Photograph& photograph, const Photograph& card, double cos_angle, const Mask& mask);

}  // namespace refield
