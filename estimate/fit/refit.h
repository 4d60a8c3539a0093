// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
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

/// Where spatial correction finds pixels: samples and current kernels at (x, y), and which rectangle of
/// pixels exists.
struct PixelAccess {
  int width = 0;
  int first_row = 0;
  int last_row = 0;
  std::function<PixelSamples(int x, int y)> samples;
  std::function<const PixelKernels&(int x, int y)> kernels;
  std::function<bool(int x, int y)> active;  ///< inside the mask
};

/// Pixels [x0, x1) × [y0, y1).
struct PixelTile {
  int x0, y0, x1, y1;
};

/// One sweep of spatial correction over a tile (Matusik et al. 2004, section 5.3): a pixel tries the
/// rectangles of its eight neighbours, fits its own weights to them, and adopts the set with the lowest
/// residual. All pixels look at their neighbours as they were before the sweep, so the order of work does not
/// matter. Returns the new kernels of the tile, row by row; inactive pixels are left empty. The Gram matrices
/// of a set are shared by all pixels that try it, which makes a sweep a fraction of the tree fit.
std::vector<PixelKernels> correct_tile(const PixelAccess& grid, const PixelTile& tile, KernelCache& cache,
                                       WeightFitter& fitter, const RunContext& run);

}  // namespace refield
