// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "estimate/fit/smooth_space.h"

namespace refield {

/// Pixels sorted into a few sets of alike ones, whose means can stand for all.
struct AlikeSets {
  int count = 0;
  std::vector<int> set_of;   ///< [pixels]
  std::vector<float> scale;  ///< [pixels], what gives each unit norm: a bright one is not to speak for all
};

/// Farthest first (Gonzalez 1985): from the pixel nearest to the mean, a pixel far from all centres begins a
/// set, as long as it is far beyond the usual. `values`: [pixels] of [3][stride] samples each, none missing;
/// `squared`: [pixels], Σ b² over channels; `stride` as in vector_kernels.h.
AlikeSets sort_alike(std::span<const std::array<const float*, 3>> values, std::span<const double> squared,
                     std::size_t stride, int max_sets);

/// Samples of a pixel that shares them with others.
struct PooledSamples {
  float* values;                       ///< [3 × extent], extended; replaced
  std::array<double, 3> noise{};       ///< variance of a sample about the pixel's own fit
  std::array<double, 3> noise_kept{};  ///< out: part of that variance which is left
};

/// Takes noise out of the samples of neighbouring pixels that see alike: the matrix of images × pixels,
/// scaled to unit noise, is of low rank but for noise, so its singular values are shrunk as Gavish and Donoho
/// 2017 ("Optimal shrinkage of singular values", Frobenius loss) prove best; what no pixel shares with others
/// vanishes in the noise. Channel by channel.
void pool_samples(std::span<PooledSamples> pixels, const SmoothSpace& smooth, int images);

}  // namespace refield
