// SPDX-License-Identifier: Apache-2.0
#include "estimate/alike_pixels.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "estimate/vector_kernels.h"

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
                     std::size_t stride, int most_sets) {
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
  while (sets.count < std::min(most_sets, count)) {
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

}  // namespace refield
