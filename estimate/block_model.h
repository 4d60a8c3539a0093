// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <span>
#include <vector>

#include "core/run_context.h"
#include "estimate/fit_block.h"
#include "estimate/fit_pixel.h"
#include "estimate/options.h"

namespace refield {

/// Hats that an estimation with these options uses.
HatGrid hats_of(const EstimateOptions& options, const LightDomain& domain, int images);

/// Fits blocks of pixels in the mode that the options ask for, before any spatial correction, with the memory
/// that a thread keeps between blocks.
class BlockModel {
 public:
  BlockModel(const BoxTable& table, const EstimateOptions& options);

  KernelCache& cache() { return cache_; }
  /// See BlockFitter::fit(); in the paper's modes, pixel by pixel and without `old`.
  std::vector<PixelKernels> fit(std::span<const PixelSamples> samples, int width,
                                std::span<const std::vector<Box>> old = {}, const RunContext& run = {});

 private:
  SmoothSpace smooth_;
  KernelCache cache_;
  std::optional<BlockFitter> block_;  // refined mode
  std::optional<PixelFitter> pixel_;  // other modes
};

}  // namespace refield
