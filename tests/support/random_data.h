// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/rng.h"
#include "core/field/reflectance_field.h"
#include "core/image/image.h"
#include "core/light/light_map.h"

namespace refield::test {

/// Values uniform in [low, high).
Image random_image(Rng& rng, int width, int height, int channels, double low = 0.0, double high = 1.0);

LightMap random_light(Rng& rng, const LightDomain& domain);

/// A box of any size inside a map.
Box random_box(Rng& rng, int map_width, int map_height);

/// A field of random boxes and weights; pixels have 0 to `max_kernels` kernels.
ReflectanceField random_field(Rng& rng, int width, int height, const LightDomain& domain, int boxes,
                              int max_kernels);

/// How often tests of damaged files damage one at random: REFIELD_FUZZ_ROUNDS of the environment, else 300.
int fuzz_rounds();

}  // namespace refield::test
