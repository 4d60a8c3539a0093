// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>
#include <vector>

#include "core/light/light_map.h"

namespace refield::peers {

/// Side of the square that a light map is padded to, with zeros, for its Haar transform: a power of two.
int haar_side(const LightDomain& domain);

/// Two-dimensional orthonormal Haar transform, in place: `square` [side × side], side a power of two. Rows
/// and columns take turns level by level (the non-standard decomposition); coefficient 0 is the mean times
/// side. Source: Stollnitz, DeRose and Salesin 1995.
void haar_transform(std::span<float> square, int side);
void inverse_haar_transform(std::span<float> square, int side);

/// The transform of a channel of a light map, [side²].
std::vector<float> haar_coefficients(const LightMap& light, int channel);

}  // namespace refield::peers
