// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "acquire/light_probe/unwrap.h"
#include "core/image.h"

namespace refield {

/// Fills what no photograph shows (weight 0: the camera itself, what is behind the ball) from the texels
/// around it: each gets their mean, weighted by solid angle and the inverse cube of the distance on the
/// sphere, so that the fill meets its surroundings without a step, at the poles and across the map's edge as
/// anywhere else. Radiance where something was seen stays as it is. Throws InputError when nothing was seen
/// at all. Source: Matusik et al. 2004, section 6, "we automatically fill in the region where the camera is
/// visible with neighboring pixels"; the weights are ours.
void fill_unseen(SeenLight& light);

/// Fraction of the sphere that was not seen.
double unseen_fraction(const Image& weight);

}  // namespace refield
