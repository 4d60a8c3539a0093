// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "estimate/fit/fit_pixel.h"
#include "estimate/fit/smooth_space.h"

namespace refield {

/// What a mirror's edge or glass reflects is too ragged for a few rectangles: with hundreds of texels of
/// different weight their errors are many times the noise. This fit divides the light map into cells, fine
/// where the pixel's rectangles are bright and coarse elsewhere, and takes the cells' weights for Gaussian
/// variables: their mean and their standard deviation are what the rectangles say there, blurred for the
/// latter, times a factor that the evidence of the samples decides. The channels share the weights but for
/// the colour of the rectangles, so that each channel is a sample of its own; hats keep theirs. (Bayesian
/// linear regression and its evidence: Rasmussen and Williams 2006, section 2.1 and chapter 5; that the mean
/// comes from the same samples is left out of account but for the number of rectangles.)
class CellFit {
 public:
  CellFit(const BoxTable& table, const SmoothSpace& smooth) : table_(table), smooth_(smooth) {}

  /// The pixel on cells, non-negative, with its leverage; null where the evidence, with what the rectangles
  /// cost in the information criterion, is for the rectangles. For complete samples.
  std::optional<PixelKernels> fit(const PixelKernels& rectangles, const MaskedSamples& samples);
  /// Of what it holds during a fit, the maps over the light's texels.
  static std::uint64_t bytes(const LightDomain& domain);

 private:
  const BoxTable& table_;
  const SmoothSpace& smooth_;
  NnlsSolver nnls_;
};

}  // namespace refield
