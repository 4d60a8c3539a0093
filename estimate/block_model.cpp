// SPDX-License-Identifier: Apache-2.0
#include "estimate/block_model.h"

#include <algorithm>

#include "core/run_context.h"

namespace refield {

HatGrid hats_of(const EstimateOptions& options, const LightDomain& domain, int images) {
  if (options.mode != EstimateMode::refined) return {};
  return hat_grid_for(domain, std::min(options.most_kernels(), images));
}

BlockModel::BlockModel(const BoxTable& table, const EstimateOptions& options)
    : smooth_(table), cache_(table, smooth_, options.mode) {
  if (options.mode == EstimateMode::refined)
    // A part of the images keeps the hats of all; they leave room for rectangles.
    block_.emplace(cache_,
                   std::min(options.most_kernels(), std::max(table.images(), table.hats().count() + 5)),
                   options.mean_square);
  else
    pixel_.emplace(cache_, options);
}

std::vector<PixelKernels> BlockModel::fit(std::span<const PixelSamples> samples, int width,
                                          std::span<const std::vector<Box>> old, const RunContext& run) {
  if (block_) return block_->fit(samples, width, old);
  std::vector<PixelKernels> kernels(samples.size());
  for (std::size_t p = 0; p < samples.size(); ++p) {
    run.throw_if_stopped();
    if (samples[p][0] != nullptr) kernels[p] = pixel_->fit(samples[p]);
  }
  return kernels;
}

}  // namespace refield
