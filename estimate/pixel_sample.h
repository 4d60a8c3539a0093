// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstddef>
#include <span>
#include <vector>

#include "core/capture_session.h"
#include "core/metrics.h"
#include "core/run_context.h"

namespace refield {

/// A few thousand pixels of all photographs, spread over the whole picture in small cells: enough to judge
/// frames by, at a fraction of the cost of reading everything. Which pixels does not depend on options, rows
/// or threads.
struct PixelSample {
  struct Cell {
    int x = 0, y = 0;  ///< its upper left corner
    int width = 0, height = 0;
    std::vector<int> pixels;  ///< numbers in the sample
  };
  int images = 0;
  int pixels = 0;
  std::vector<Cell> cells;
  std::vector<float> values;  ///< [3][pixels][images], NaN where not measured

  float* series(int channel, int pixel) {
    return values.data() + (static_cast<std::size_t>(channel) * pixels + pixel) * images;
  }
  const float* series(int channel, int pixel) const {
    return values.data() + (static_cast<std::size_t>(channel) * pixels + pixel) * images;
  }
  /// Of what was measured in the images that are not left out; 0 where that is nothing.
  double mean_square(std::span<const int> left_out) const;
};

/// Reads at most 12 × 16 cells of at most 12 pixels, inside the mask. Samples at or above `clip_level` count
/// as not measured. Reads about 12 blocks of 16 rows of each photograph. Errors as read_observations().
PixelSample read_pixel_sample(std::span<const CaptureFrame> frames, int width, int height, const Mask& mask,
                              float clip_level, const RunContext& run);

}  // namespace refield
