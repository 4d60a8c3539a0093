// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <vector>

#include "estimate/fit/fit_pixel.h"
#include "estimate/fit/weighted_fit.h"

namespace refield {

/// What is done for pixels that lack samples (clipped in every exposure): the search works on complete
/// vectors, so what was not measured is estimated by a tree that sees only what was, and filled in anew from
/// later fits; in the end the rectangles of both are pruned in exact fits to what was measured.
class GapFiller {
 public:
  explicit GapFiller(KernelCache& cache);

  /// Fills in what was not measured; returns the rectangles of the tree that predicted it. `values`:
  /// extended, [3 × extent].
  std::vector<Box> estimate(const PixelSamples& pixel, const MaskedSamples& samples, AlignedFloats& values);
  /// Fills it in from a fit: `predicted` [3 × stride].
  void fill_in(const MaskedSamples& samples, const AlignedFloats& predicted, AlignedFloats& values) const;

  struct Pruned {
    PixelKernels kernels;
    int smooth_class = 0;
    double criterion = 0.0;
  };
  /// From `boxes`, takes away the rectangle that brings least light, one by one, down to what the information
  /// criterion bears, in the class found and without a smooth part. `search_penalty`: see PixelCoordinates;
  /// `noise_kept`: see KernelSelector::solve().
  Pruned prune(const std::vector<Box>& boxes, int found_class, const MaskedSamples& samples,
               double search_penalty, const std::array<double, 3>& noise_kept, WeightedFit& weighted) const;

 private:
  KernelCache& cache_;
  const SmoothSpace& smooth_;
  PixelFitter fitter_;
};

}  // namespace refield
