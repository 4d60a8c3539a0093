// SPDX-License-Identifier: Apache-2.0
#include "estimate/pixel_sample.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "estimate/observations.h"

namespace refield {

namespace {

constexpr int cell_rows = 12;
constexpr int cell_columns = 16;
constexpr int block = 16;  ///< rows that an EXR file compresses together
constexpr int pixels_across = 4;
constexpr int pixels_down = 3;
constexpr int least_cell_side = 4;

/// Starts of at most `most` cells of `size` pixels along a side of `length`, spread evenly, each a multiple
/// of the size where that is the block.
std::vector<int> starts(int length, int most, int size) {
  const int there = std::max(1, length / size);
  const int count = std::min(most, there);
  std::vector<int> result;
  for (int i = 0; i < count; ++i) result.push_back(there * (2 * i + 1) / (2 * count) * size);
  return result;
}

/// Where in a cell of `size` the i-th of `count` pixels lies.
int offset(int i, int count, int size) {
  return (2 * i + 1) * size / (2 * count);
}

}  // namespace

double PixelSample::mean_square(std::span<const int> left_out) const {
  double sum = 0.0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!std::isfinite(values[i]) || std::ranges::count(left_out, static_cast<int>(i % images)) > 0) continue;
    sum += static_cast<double>(values[i]) * values[i];
    ++count;
  }
  return count > 0 ? sum / static_cast<double>(count) : 0.0;
}

PixelSample read_pixel_sample(std::span<const CaptureFrame> frames, int width, int height, const Mask& mask,
                              float clip_level, const RunContext& run) {
  const int cell_height = std::clamp(height / cell_rows, least_cell_side, block);
  const int cell_width = std::max(least_cell_side, width / cell_columns);
  struct Place {
    int x, y;
  };
  PixelSample sample;
  sample.images = static_cast<int>(frames.size());
  std::vector<std::vector<Place>> bands;  // the places of each row of cells
  std::vector<int> band_rows = starts(height, cell_rows, cell_height);
  for (const int y0 : band_rows) {
    auto& places = bands.emplace_back();
    for (const int x0 : starts(width, cell_columns, cell_width)) {
      PixelSample::Cell cell{x0, y0, cell_width, cell_height, {}};
      for (int j = 0; j < pixels_down; ++j)
        for (int i = 0; i < pixels_across; ++i) {
          const int x = x0 + offset(i, pixels_across, cell_width);
          const int y = y0 + offset(j, pixels_down, cell_height);
          if (x >= width || y >= height) continue;
          if (!mask.empty() && mask[static_cast<std::size_t>(y) * width + x] == 0) continue;
          cell.pixels.push_back(sample.pixels++);
          places.push_back({x, y});
        }
      if (!cell.pixels.empty()) sample.cells.push_back(std::move(cell));
    }
  }
  sample.values.resize(std::size_t{3} * sample.pixels * sample.images);
  int pixel = 0;
  for (std::size_t b = 0; b < bands.size(); ++b) {
    if (bands[b].empty()) continue;
    const int last = std::min(band_rows[b] + cell_height, height);
    const auto band = read_observations(frames, width, band_rows[b], last, clip_level, run);
    for (const Place& place : bands[b]) {
      for (int c = 0; c < 3; ++c)
        std::copy_n(band.samples(place.x, place.y, c), sample.images, sample.series(c, pixel));
      ++pixel;
    }
  }
  return sample;
}

}  // namespace refield
