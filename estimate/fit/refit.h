// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>
#include <vector>

#include "estimate/fit/fit_pixel.h"

namespace refield {

/// A set of rectangles made ready for fitting: their columns and, where every image counts, the Gram matrices
/// AᵀA, which depend on the lights alone and so serve every pixel that tries this set.
struct KernelSet {
  std::vector<Box> boxes;
  std::array<std::vector<const float*>, 3> columns;  ///< [boxes] of each channel, owned by the cache
  std::array<std::vector<double>, 3> gram;           ///< [boxes × boxes] of each channel
};

KernelSet prepare_kernel_set(std::span<const Box> boxes, KernelCache& cache);

/// Fits weights to given rectangles: min ‖A W − B‖², W ≥ 0 (eq. 6), channel by channel.
class WeightFitter {
 public:
  explicit WeightFitter(const BoxTable& table) : images_(table.images()), stride_(table.stride()) {}

  /// The squared residual that a set reaches on a pixel, over all channels; stops early once it exceeds
  /// `give_up_above`. `start` holds weights [boxes × 3] to begin from. The weights found are kept for
  /// weights().
  double try_set(const KernelSet& set, const MaskedSamples& samples, std::span<const float> start,
                 double give_up_above);
  /// Weights of the last set tried, [boxes × 3].
  const std::vector<double>& weights() const { return weights_; }

  /// Final weights: solved, then refined once with the residual B − A W summed over images, which removes the
  /// rounding of float32 Gram matrices. Kernels of weight zero are dropped.
  PixelKernels fit(const KernelSet& set, const MaskedSamples& samples, std::span<const float> start);

 private:
  const double* masked_gram(const KernelSet& set, const MaskedSamples& samples, int channel);

  int images_;
  std::size_t stride_;
  NnlsSolver nnls_;
  std::vector<double> weights_, h_, x_, gram_;
  std::vector<const float*> pointers_;
  std::vector<float> products_;
  AlignedFloats scratch_;
};

}  // namespace refield
