// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "estimate/fit/fit_pixel.h"
#include "estimate/fit/smooth_space.h"

namespace refield {

/// Non-negative weights of given rectangles and, in a class with a smooth part, of the hats, from the samples
/// of one pixel in image space: for pixels that lack samples, whose Gram matrices are their own, and for
/// rectangles that no dictionary holds.
class WeightedFit {
 public:
  WeightedFit(const BoxTable& table, const SmoothSpace& smooth);

  /// Fits `boxes`; those that get no weight are dropped. Unmeasured samples are left out. `noise_kept`: see
  /// KernelSelector::solve().
  PixelKernels fit(std::span<const Box> boxes, int smooth_class, const MaskedSamples& samples,
                   const std::array<double, 3>& noise_kept);
  /// Samples minus fit, [3 × stride], zero where not measured. Of the last fit.
  const AlignedFloats& residual() const { return residual_; }
  /// What the fit says of all samples, measured or not, [3 × stride]. Of the last fit.
  const AlignedFloats& predicted() const { return fit_; }

 private:
  const BoxTable& table_;
  const SmoothSpace& smooth_;
  std::size_t stride_;
  AlignedFloats columns_, fit_, residual_, masked_;
  std::vector<double> gram_, h_, x_;
  std::vector<const float*> pointers_;
  std::vector<float> products_;
  NnlsSolver nnls_;
};

/// BIC of a fit, and `search_penalty` per rectangle; without the evidence of its smooth part.
double criterion_of(const PixelKernels& kernels, int measured, double search_penalty);

/// How far edges are moved: to the texel, or once and to a small part of the rectangle's own size.
enum class EdgeSteps { to_the_texel, coarse };

/// Moves the edges of a pixel's rectangles to where they explain its samples best: a tree offers edges at
/// thirds and halves, while what a mirror sees ends anywhere. Coordinate descent over the edges, coarse steps
/// first; each move is assessed with the other kernels' part of the fit held. `residual`: samples minus fit.
/// Limit: reading columns from the table, which is far larger than any cache.
/// Returns the rectangles in the same order.
std::vector<Box> refine_edges(const BoxTable& table, const PixelKernels& kernels,
                              const AlignedFloats& residual, EdgeSteps steps);

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
