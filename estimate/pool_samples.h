// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <span>

#include "estimate/smooth_space.h"

namespace refield {

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
