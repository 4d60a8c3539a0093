// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>
#include <span>

#include "core/base/run_context.h"
#include "estimate/fit/refit.h"

namespace refield {

/// Where spatial correction finds pixels: samples and current kernels at (x, y), and which rectangle of
/// pixels exists.
struct PixelGrid {
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
std::vector<PixelKernels> correct_tile(const PixelGrid& grid, const PixelTile& tile, KernelCache& cache,
                                       WeightFitter& fitter, const RunContext& run);

}  // namespace refield
