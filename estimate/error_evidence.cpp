// SPDX-License-Identifier: Apache-2.0
#include "estimate/error_evidence.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace refield {

namespace {
/// An image that determines a kernel nearly alone (h near 1) tells nothing about it: its residual grows no
/// further than twentyfold.
constexpr float least_freedom = 0.05f;
/// Columns that keep less than this part of their squared norm are combinations of those before.
constexpr float dependence_tolerance = 1e-6f;
}  // namespace

double ErrorJudge::leave_one_out(const KernelSet& set, const PixelKernels& kernels,
                                 const MaskedSamples& samples, float* residuals) {
  const std::size_t count = kernels.boxes.size();
  orthonormal_.resize(std::max(count, std::size_t{1}) * stride_);
  vector_.resize(stride_);
  pointers_.resize(std::max(count, std::size_t{1}));
  coefficients_.resize(pointers_.size());
  double squared = 0.0;
  for (int c = 0; c < 3; ++c) {
    float* residual = residuals + c * stride_;
    const float* measured = samples.complete ? nullptr : samples.measured.data() + c * stride_;
    std::copy_n(samples.values.data() + c * stride_, stride_, residual);
    AlignedFloats& leverage = vector_;
    std::vector<float>& weight = coefficients_;
    for (std::size_t k = 0; k < count; ++k) {
      pointers_[k] = set.columns[k] + c * stride_;
      weight[k] = kernels.weights[3 * k + c];
    }
    subtract_combination(residual, pointers_.data(), weight.data(), count, stride_);
    std::size_t rank = 0;
    for (std::size_t k = 0; k < count; ++k) {
      if (!(kernels.weights[3 * k + c] > 0.0f)) continue;
      const float* column = set.columns[k] + c * stride_;
      float* q = orthonormal_.data() + rank * stride_;
      if (measured)
        std::transform(column, column + stride_, measured, q, std::multiplies<>());
      else
        std::copy_n(column, stride_, q);
      const float* self = q;
      float before = 0.0f, after = 0.0f;
      dots(q, &self, 1, stride_, &before);
      for (std::size_t i = 0; i < rank; ++i) pointers_[i] = orthonormal_.data() + i * stride_;
      for (int pass = 0; pass < 2; ++pass) {
        dots(q, pointers_.data(), rank, stride_, coefficients_.data());
        subtract_combination(q, pointers_.data(), coefficients_.data(), rank, stride_);
      }
      dots(q, &self, 1, stride_, &after);
      if (!(after > dependence_tolerance * before)) continue;
      const float scale = 1.0f / std::sqrt(after);
      std::transform(q, q + stride_, q, [scale](float v) { return v * scale; });
      ++rank;
    }
    leverage.assign(stride_, 0.0f);
    for (std::size_t i = 0; i < rank; ++i) {
      const float* q = orthonormal_.data() + i * stride_;
      for (std::size_t j = 0; j < stride_; ++j) leverage[j] += q[j] * q[j];
    }
    for (std::size_t j = 0; j < stride_; ++j) {
      float r = residual[j] / std::max(1.0f - leverage[j], least_freedom);
      if (measured) r *= measured[j];
      residual[j] = r;
      squared += static_cast<double>(r) * r;
    }
  }
  return squared;
}

/// Fits the pixel to the images that `is_seen` and sums its squared error on the others.
template <class IsSeen>
double ErrorJudge::error_on_unseen(PixelFitter& fitter, KernelCache& cache, const PixelSamples& samples,
                                   IsSeen is_seen) {
  reduced_.resize(3 * stride_);
  PixelSamples seen;
  for (int c = 0; c < 3; ++c) {
    float* values = reduced_.data() + c * stride_;
    std::copy_n(samples[c], stride_, values);
    for (int j = 0; j < images_; ++j)
      if (!is_seen(j)) values[j] = std::numeric_limits<float>::quiet_NaN();
    seen[c] = values;
  }
  const PixelKernels kernels = fitter.fit(seen);
  const std::size_t count = kernels.boxes.size();
  pointers_.resize(std::max(count, std::size_t{1}));
  for (std::size_t k = 0; k < count; ++k) pointers_[k] = cache.column(kernels.boxes[k]);
  double squared = 0.0;
  for (int c = 0; c < 3; ++c)
    for (int j = 0; j < images_; ++j) {
      const float b = samples[c][j];
      if (is_seen(j) || std::isnan(b)) continue;
      double predicted = 0.0;
      for (std::size_t k = 0; k < count; ++k)
        predicted += static_cast<double>(kernels.weights[3 * k + c]) * pointers_[k][c * stride_ + j];
      squared += (predicted - b) * (predicted - b);
    }
  return squared;
}

double ErrorJudge::cross_validate(PixelFitter& fitter, KernelCache& cache, const PixelSamples& samples,
                                  int folds) {
  folds = std::min(folds, images_);
  double squared = 0.0;
  for (int fold = 0; fold < folds; ++fold)
    squared += error_on_unseen(fitter, cache, samples, [=](int j) { return j % folds != fold; });
  return squared;
}

double ErrorJudge::validate_folds_alone(PixelFitter& fitter, KernelCache& cache, const PixelSamples& samples,
                                        int folds) {
  folds = std::min(folds, images_);
  double squared = 0.0;
  for (int fold = 0; fold < folds; ++fold)
    squared += error_on_unseen(fitter, cache, samples, [=](int j) { return j % folds == fold; });
  return squared / std::max(folds - 1, 1);
}

}  // namespace refield
