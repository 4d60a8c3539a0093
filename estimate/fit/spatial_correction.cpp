// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/spatial_correction.h"

#include <algorithm>

#include "core/base/run_context.h"

namespace refield {

namespace {

/// A neighbour's set must be better by more than the rounding of the two residuals.
constexpr double clear_gain = 1e-6;

}  // namespace

std::vector<PixelKernels> correct_tile(const PixelGrid& grid, const PixelTile& tile, KernelCache& cache,
                                       WeightFitter& fitter, const RunContext& run) {
  const PixelTile reach = {std::max(tile.x0 - 1, 0), std::max(tile.y0 - 1, grid.first_row),
                           std::min(tile.x1 + 1, grid.width), std::min(tile.y1 + 1, grid.last_row)};
  const int reach_width = reach.x1 - reach.x0;
  std::vector<KernelSet> sets(static_cast<std::size_t>(reach_width) * (reach.y1 - reach.y0));
  const auto set_at = [&](int x, int y) -> KernelSet& {
    return sets[static_cast<std::size_t>(y - reach.y0) * reach_width + (x - reach.x0)];
  };
  for (int y = reach.y0; y < reach.y1; ++y)
    for (int x = reach.x0; x < reach.x1; ++x)
      if (grid.active(x, y)) set_at(x, y) = prepare_kernel_set(grid.kernels(x, y).boxes, cache);

  std::vector<PixelKernels> corrected;
  MaskedSamples samples;
  PixelKernels trial;
  for (int y = tile.y0; y < tile.y1; ++y) {
    run.throw_if_stopped();
    for (int x = tile.x0; x < tile.x1; ++x) {
      corrected.emplace_back();
      if (!grid.active(x, y)) continue;
      PixelKernels& best = corrected.back();
      best = grid.kernels(x, y);
      samples.assign(grid.samples(x, y), cache.table().stride(), cache.table().images());
      const std::vector<Box>& own_boxes = grid.kernels(x, y).boxes;
      for (int ny = std::max(y - 1, reach.y0); ny < std::min(y + 2, reach.y1); ++ny)
        for (int nx = std::max(x - 1, reach.x0); nx < std::min(x + 2, reach.x1); ++nx) {
          if ((nx == x && ny == y) || !grid.active(nx, ny)) continue;
          const KernelSet& set = set_at(nx, ny);
          if (set.boxes.empty() || set.boxes == own_boxes) continue;
          const double give_up_above = best.squared_residual * (1.0 - clear_gain);
          trial.squared_residual = fitter.try_set(set, samples, grid.kernels(nx, ny).weights, give_up_above);
          if (trial.squared_residual >= give_up_above) continue;
          trial.weights.assign(fitter.weights().begin(), fitter.weights().end());
          best.boxes = set.boxes;
          best.weights = trial.weights;
          best.squared_residual = trial.squared_residual;
        }
    }
  }
  return corrected;
}

}  // namespace refield
