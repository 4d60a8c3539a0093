// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/similar_pixels.h"

#include <Eigen/Core>

#include <algorithm>
#include <cmath>

#include "core/base/linear_algebra.h"
#include "estimate/fit/sample_pooling.h"
#include "estimate/fit/vector_kernels.h"

namespace refield {

namespace {
/// A pixel begins a set of its own when its squared distance is this many times the median's.
constexpr float far_beyond = 3.0f;

/// Gram matrix of the scaled pixels.
Eigen::MatrixXf gram_of(std::span<const std::array<const float*, 3>> values, const std::vector<float>& scale,
                        std::size_t stride) {
  const int count = static_cast<int>(values.size());
  Eigen::MatrixXf gram = Eigen::MatrixXf::Zero(count, count);
  std::vector<const float*> pointers(count);
  std::vector<float> products(count);
  for (int c = 0; c < 3; ++c) {
    for (int p = 0; p < count; ++p) pointers[p] = values[p][c];
    for (int p = 0; p < count; ++p) {
      dots(pointers[p], pointers.data(), count, stride, products.data());
      for (int q = 0; q < count; ++q) gram(p, q) += scale[p] * scale[q] * products[q];
    }
  }
  return gram;
}
}  // namespace

AlikeSets sort_alike(std::span<const std::array<const float*, 3>> values, std::span<const double> squared,
                     std::size_t stride, int max_sets) {
  const int count = static_cast<int>(values.size());
  AlikeSets sets;
  sets.scale.resize(count);
  for (int p = 0; p < count; ++p)
    sets.scale[p] = squared[p] > 0.0 ? static_cast<float>(1.0 / std::sqrt(squared[p])) : 0.0f;
  const Eigen::MatrixXf gram = gram_of(values, sets.scale, stride);
  const auto distance2 = [&](int p, int q) { return gram(p, p) + gram(q, q) - 2.0f * gram(p, q); };
  const Eigen::VectorXf to_all = gram.rowwise().sum();
  const auto to_mean = [&](int p) { return gram(p, p) * count - 2.0f * to_all[p]; };
  int centre = 0;
  for (int p = 1; p < count; ++p)
    if (to_mean(p) < to_mean(centre)) centre = p;
  sets.set_of.assign(count, 0);
  sets.count = 1;
  std::vector<float> nearest(count);
  for (int p = 0; p < count; ++p) nearest[p] = distance2(p, centre);
  while (sets.count < std::min(max_sets, count)) {
    std::vector<float> sorted = nearest;
    std::ranges::nth_element(sorted, sorted.begin() + count / 2);
    const int far = static_cast<int>(std::ranges::max_element(nearest) - nearest.begin());
    if (!(nearest[far] > far_beyond * sorted[count / 2])) break;
    for (int p = 0; p < count; ++p)
      if (const float d = distance2(p, far); d < nearest[p]) {
        nearest[p] = d;
        sets.set_of[p] = sets.count;
      }
    ++sets.count;
  }
  return sets;
}

namespace {

/// Noise is taken as no less than this part of a sample, squared: what float32 tells.
constexpr double least_noise = 1e-10;

}  // namespace

void pool_samples(std::span<PooledSamples> pixels, const SmoothSpace& smooth, int images) {
  const int count = static_cast<int>(pixels.size());
  const std::size_t stride = smooth.stride(), extent = smooth.extent();
  std::vector<AlignedFloats> before(count);
  std::vector<const float*> pointers(count);
  std::vector<float> products(count);
  for (int c = 0; c < 3; ++c) {
    Eigen::VectorXd scale(count);
    for (int p = 0; p < count; ++p) {
      const float* b = pixels[p].values + c * extent;
      before[p].assign(b, b + stride);
      pointers[p] = before[p].data();
      float squared = 0.0f;
      dots(b, &pointers[p], 1, stride, &squared);
      const double noise = std::max(pixels[p].noise[c], least_noise * squared / images);
      scale[p] = squared > 0.0f && noise > 0.0 ? 1.0 / std::sqrt(noise) : 0.0;
    }
    Eigen::MatrixXd gram(count, count);
    for (int p = 0; p < count; ++p) {
      dots(pointers[p], pointers.data(), p + 1, stride, products.data());
      for (int q = 0; q <= p; ++q) gram(p, q) = gram(q, p) = scale[p] * scale[q] * products[q];
    }
    const SymmetricEigen eigen = symmetric_eigen(gram);
    const double ratio = static_cast<double>(count) / images;
    // A residual holds the fit's own error besides noise; the median component holds noise alone.
    const double median = eigen.values[count / 2] / images;
    const double noise = median > 0.0 ? std::min(median, 1.0) : 1.0;
    Eigen::VectorXd kept(count);
    for (int k = 0; k < count; ++k) kept[k] = kept_share(eigen.values[k] / images / noise, ratio);
    const Eigen::MatrixXd mix = eigen.vectors * kept.asDiagonal() * eigen.vectors.transpose();
    for (int p = 0; p < count; ++p) {
      pixels[p].noise_kept[c] = 1.0;
      if (!(scale[p] > 0.0)) continue;
      float* b = pixels[p].values + c * extent;
      std::fill_n(b, stride, 0.0f);
      for (int q = 0; q < count; ++q) products[q] = static_cast<float>(-mix(q, p) * scale[q] / scale[p]);
      subtract_combination(b, pointers.data(), products.data(), count, stride);
      smooth.extend(b, c);
      pixels[p].noise_kept[c] = mix.col(p).squaredNorm();
    }
  }
}

}  // namespace refield
