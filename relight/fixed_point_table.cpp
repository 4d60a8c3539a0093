// SPDX-License-Identifier: Apache-2.0
#include "relight/fixed_point_table.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>

#include "core/errors.h"

namespace refield {

namespace {

constexpr int strip_rows = 64;

/// No box comes to more steps; a little is left for rounding of the total.
constexpr double largest_sum = 2147483000.0;

/// The nearest whole number, modulo 2³², of a value below 2⁵⁰: adding 1.5 · 2⁵² leaves it in the low bits.
std::int32_t wrapped(double value) {
  return static_cast<std::int32_t>(
      static_cast<std::uint32_t>(std::bit_cast<std::uint64_t>(value + 0x1.8p52)));
}

}  // namespace

void FixedPointTable::build(const Image& light) {
  if (light.channels != 3 || light.empty())
    throw InputError("a summed-area table needs an RGB image, not one of " + shape_text(light));
  width_ = light.width;
  const int strips = (light.height + strip_rows - 1) / strip_rows;
  const auto values = static_cast<std::size_t>(light.width) * 3;
  corners_.resize(static_cast<std::size_t>(stride()) * (light.height + 1) * 3 + 1);
  columns_.assign(values * static_cast<std::size_t>(strips + 1), 0.0);
  std::vector<std::array<double, 3>> magnitude(static_cast<std::size_t>(strips), {0.0, 0.0, 0.0});
  const auto last_row = [&](int strip) { return std::min((strip + 1) * strip_rows, light.height); };

  // Strips of rows go to different cores; each starts from what the columns above it hold.
  tbb::parallel_for(0, strips, [&](int strip) {
    double* sums = columns_.data() + values * static_cast<std::size_t>(strip + 1);
    for (int y = strip * strip_rows; y < last_row(strip); ++y) {
      const float* texels = light.row(y).data();
      for (std::size_t i = 0; i < values; ++i) sums[i] += texels[i];
      float row[3] = {0.0f, 0.0f, 0.0f};
      for (std::size_t i = 0; i < values; i += 3)
        for (std::size_t c = 0; c < 3; ++c) row[c] += std::abs(texels[i + c]);
      for (std::size_t c = 0; c < 3; ++c) magnitude[static_cast<std::size_t>(strip)][c] += row[c];
    }
  });
  double total[3] = {0.0, 0.0, 0.0};
  for (const auto& strip : magnitude)
    for (std::size_t c = 0; c < 3; ++c) total[c] += strip[c];
  for (int strip = 0; strip < strips; ++strip) {
    const double* above = columns_.data() + values * static_cast<std::size_t>(strip);
    double* sums = columns_.data() + values * static_cast<std::size_t>(strip + 1);
    for (std::size_t i = 0; i < values; ++i) sums[i] += above[i];
  }
  double steps_in_one[3];
  for (int c = 0; c < 3; ++c) {
    const double step = total[c] > 0.0 ? total[c] / largest_sum : 1.0;
    step_[static_cast<std::size_t>(c)] = static_cast<float>(step);
    steps_in_one[c] = 1.0 / step;
  }

  std::fill_n(corners_.begin(), static_cast<std::size_t>(stride()) * 3, 0);
  tbb::parallel_for(0, strips, [&](int strip) {
    double* columns = columns_.data() + values * static_cast<std::size_t>(strip);
    for (int y = strip * strip_rows; y < last_row(strip); ++y) {
      const float* texels = light.row(y).data();
      std::int32_t* corner = corners_.data() + static_cast<std::size_t>(y + 1) * stride() * 3;
      std::fill_n(corner, 3, 0);
      double sum[3] = {0.0, 0.0, 0.0};
      for (std::size_t i = 0; i < values; i += 3) {
        corner += 3;
        for (std::size_t c = 0; c < 3; ++c) {
          columns[i + c] += texels[i + c];
          sum[c] += columns[i + c];
          corner[c] = wrapped(sum[c] * steps_in_one[c]);
        }
      }
    }
  });
}

}  // namespace refield
