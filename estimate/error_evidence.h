// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "core/predicted_error.h"
#include "estimate/fit_pixel.h"
#include "estimate/refit.h"

namespace refield {

/// What a thread needs to judge fits by images that they have not seen.
class ErrorJudge {
 public:
  explicit ErrorJudge(const BoxTable& table) : images_(table.images()), stride_(table.stride()) {}

  /// Leave-one-out residuals of a pixel's final kernels: r_j / (1 − h_j), channel by channel, where h_j is
  /// the diagonal of the projection onto the columns with a weight above zero. Exact for least squares with
  /// that set of kernels (Allen 1974). Writes [3 × stride], zero where not measured, and returns their
  /// squared sum.
  double leave_one_out(const KernelSet& set, const PixelKernels& kernels, const MaskedSamples& samples,
                       float* residuals);

  /// Squared error, over images and channels, of k-fold cross-validation: the pixel is fitted anew without
  /// each fold (images j, j + k, …), choice of kernels included, and predicts it. Of k folds there are at
  /// most as many as images.
  double cross_validate(PixelFitter& fitter, KernelCache& cache, const PixelSamples& samples, int folds = 5);
  /// The other way round, for fits to few images: each fold alone is fitted and predicts all others. The mean
  /// over the k − 1 predictions of each image, on the same scale.
  double validate_folds_alone(PixelFitter& fitter, KernelCache& cache, const PixelSamples& samples,
                              int folds);

 private:
  template <class IsSeen>
  double error_on_unseen(PixelFitter& fitter, KernelCache& cache, const PixelSamples& samples,
                         IsSeen is_seen);

  int images_;
  std::size_t stride_;
  AlignedFloats orthonormal_, vector_, reduced_;
  std::vector<const float*> pointers_;
  std::vector<float> coefficients_;
};

}  // namespace refield
