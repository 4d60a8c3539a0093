// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/refit.h"

#include <algorithm>
#include <functional>
#include <limits>

namespace refield {

namespace {

/// Gram matrix of the columns of one channel; `first` yields the i-th column as the left factor (perhaps
/// masked).
template <class LeftColumn>
void fill_gram(const std::vector<const float*>& columns, std::size_t stride, LeftColumn left,
               std::vector<double>& gram) {
  const std::size_t count = columns.size();
  std::vector<float> products(count);
  gram.resize(count * count);
  for (std::size_t i = 0; i < count; ++i) {
    dots(left(i), columns.data(), i + 1, stride, products.data());
    for (std::size_t k = 0; k <= i; ++k) gram[i * count + k] = gram[k * count + i] = products[k];
  }
}

}  // namespace

KernelSet prepare_kernel_set(std::span<const Box> boxes, KernelCache& cache) {
  KernelSet set;
  set.boxes.assign(boxes.begin(), boxes.end());
  for (int c = 0; c < 3; ++c) {
    auto& columns = set.columns[c];
    for (const Box& box : boxes) columns.push_back(cache.column(box, c));
    fill_gram(
        columns, cache.table().stride(), [&](std::size_t i) { return columns[i]; }, set.gram[c]);
  }
  return set;
}

const double* WeightFitter::masked_gram(const KernelSet& set, const MaskedSamples& samples, int channel) {
  if (samples.complete) return set.gram[channel].data();
  scratch_.resize(stride_);
  const float* measured = samples.measured.data() + channel * stride_;
  fill_gram(
      pointers_, stride_,
      [&](std::size_t i) {
        std::transform(pointers_[i], pointers_[i] + stride_, measured, scratch_.data(), std::multiplies<>());
        return scratch_.data();
      },
      gram_);
  return gram_.data();
}

double WeightFitter::try_set(const KernelSet& set, const MaskedSamples& samples, std::span<const float> start,
                             double give_up_above) {
  const std::size_t count = set.boxes.size();
  products_.resize(count);
  h_.resize(count);
  x_.resize(count);
  weights_.assign(3 * count, 0.0);
  double residual = 0.0;
  for (int c = 0; c < 3; ++c) {
    pointers_ = set.columns[c];
    dots(samples.values.data() + c * stride_, pointers_.data(), count, stride_, products_.data());
    for (std::size_t k = 0; k < count; ++k) {
      h_[k] = products_[k];
      x_[k] = start[3 * k + c];
    }
    const double* G = masked_gram(set, samples, c);
    nnls_.solve(G, static_cast<int>(count), h_.data(), static_cast<int>(count), x_.data());
    residual += squared_residual(G, static_cast<int>(count), h_.data(), static_cast<int>(count), x_.data(),
                                 samples.squared[c]);
    if (residual >= give_up_above) return residual;
    for (std::size_t k = 0; k < count; ++k) weights_[3 * k + c] = x_[k];
  }
  return residual;
}

PixelKernels WeightFitter::fit(const KernelSet& set, const MaskedSamples& samples,
                               std::span<const float> start) {
  try_set(set, samples, start, std::numeric_limits<double>::infinity());
  const std::size_t count = set.boxes.size();
  AlignedFloats residual(stride_);
  std::vector<float> minus(count);
  PixelKernels kernels;
  for (int c = 0; c < 3; ++c) {
    pointers_ = set.columns[c];
    const double* G = masked_gram(set, samples, c);
    const auto compute_residual = [&] {
      std::copy_n(samples.values.data() + c * stride_, stride_, residual.data());
      for (std::size_t k = 0; k < count; ++k) minus[k] = static_cast<float>(weights_[3 * k + c]);
      subtract_combination(residual.data(), pointers_.data(), minus.data(), count, stride_);
      if (!samples.complete)
        std::transform(residual.begin(), residual.end(), samples.measured.data() + c * stride_,
                       residual.begin(), std::multiplies<>());
    };
    compute_residual();
    dots(residual.data(), pointers_.data(), count, stride_, products_.data());
    for (std::size_t k = 0; k < count; ++k) x_[k] = minus[k];
    for (std::size_t k = 0; k < count; ++k) {
      h_[k] = products_[k];
      for (std::size_t l = 0; l < count; ++l) h_[k] += G[k * count + l] * x_[l];
    }
    nnls_.solve(G, static_cast<int>(count), h_.data(), static_cast<int>(count), x_.data());
    for (std::size_t k = 0; k < count; ++k) weights_[3 * k + c] = x_[k];
    compute_residual();
    for (int j = 0; j < images_; ++j)
      kernels.squared_residual += static_cast<double>(residual[j]) * residual[j];
    kernels.squared_samples += samples.squared[c];
  }
  for (std::size_t k = 0; k < count; ++k) {
    const double* w = weights_.data() + 3 * k;
    if (w[0] <= 0.0 && w[1] <= 0.0 && w[2] <= 0.0) continue;
    kernels.boxes.push_back(set.boxes[k]);
    for (int c = 0; c < 3; ++c) kernels.weights.push_back(static_cast<float>(w[c]));
  }
  return kernels;
}

}  // namespace refield
