// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "bench/studies/peers/peer_data.h"
#include "core/field/reflectance_field.h"

namespace refield::test {

/// Photographs of `field` under the lights, with relative Gaussian noise, as peers take them.
peers::PeerData photographed(const ReflectanceField& field, std::vector<LightMap> lights, double noise = 0.0);

/// sqrt(Σ(a − b)² / Σ b²) over two images of one shape.
double relative_difference(const Image& a, const Image& b);

}  // namespace refield::test
