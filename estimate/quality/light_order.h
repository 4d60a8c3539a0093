// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/light/light_map.h"

namespace refield {

/// The order in which to photograph candidate lights, most useful first: indices into `lights`. Needs no
/// photograph.
///
/// A pixel's response is taken as a Gaussian process over lights whose covariance is that of a pixel that
/// sees one rectangle of unknown size and place: the mean, over grids of 1×1, 2×2 … 32×32 cells, of the
/// products of the two lights' cell means. Each light is chosen so that, once photographed with `noise`, the
/// mean variance that remains over all candidates is lowest (Cohn 1996). `noise` is a part of the root mean
/// square over the candidates' samples, the same for bright and dim lights; what a sparse field misses counts
/// as noise here, so it is more than a camera has. O(n³) time for n lights. Throws InputError when sizes
/// differ.
std::vector<int> max_useful_order(std::span<const LightMap> lights, double noise = 0.1);

/// A random order, equal for equal seeds.
std::vector<int> random_order(int lights, std::uint64_t seed);

}  // namespace refield
