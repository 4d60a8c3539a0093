// SPDX-License-Identifier: Apache-2.0
#include "relight/tiles/box_sums.h"

#include <tbb/parallel_for.h>

#include <bit>
#include <cmath>

#include "relight/tiles/tile_vectors.h"

// Highway compiles the part between BEFORE and AFTER once for each instruction set and picks one at run time.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "relight/tiles/fixed_point_table.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace refield::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// Adding this to a value below 2⁵⁰ leaves the nearest whole number in the low bits.
constexpr double whole_number = 0x1.8p52;

/// Adds `texels` to `columns`; returns the least of them, or zero.
float add_row_vectorised(const float* HWY_RESTRICT texels, std::size_t count, double* HWY_RESTRICT columns) {
  const hn::ScalableTag<double> d;
  const hn::Rebind<float, decltype(d)> narrow;
  auto lowest = hn::Zero(narrow);
  std::size_t i = 0;
  for (; i + hn::Lanes(d) <= count; i += hn::Lanes(d)) {
    const auto some = hn::LoadU(narrow, texels + i);
    lowest = hn::Min(lowest, some);
    hn::StoreU(hn::Add(hn::LoadU(d, columns + i), hn::PromoteTo(d, some)), d, columns + i);
  }
  float minimum = hn::GetLane(hn::MinOfLanes(narrow, lowest));
  for (; i < count; ++i) {
    columns[i] += texels[i];
    minimum = HWY_MIN(minimum, texels[i]);
  }
  return minimum;
}

/// The corners right of `texels` texels below a row, from the sums of their columns.
void prefix_row_vectorised(const double* HWY_RESTRICT columns, std::size_t texels,
                           const double* HWY_RESTRICT steps_in_one, std::int32_t* HWY_RESTRICT corners) {
  double sum[4] = {0.0, 0.0, 0.0, 0.0};
  std::size_t x = 0;
  const hn::CappedTag<double, 4> d;
  if constexpr (hn::MaxLanes(hn::CappedTag<double, 4>()) == 4) {
    // Three channels and one number more, which the next texel overwrites; the last has none.
    const hn::Repartition<std::uint64_t, decltype(d)> bits;
    const hn::Rebind<std::uint32_t, decltype(d)> low;
    const auto scale = hn::LoadU(d, steps_in_one);
    const auto magic = hn::Set(d, whole_number);
    auto sums = hn::Zero(d);
    for (; x + 1 < texels; ++x) {
      sums = hn::Add(sums, hn::LoadU(d, columns + 3 * x));
      const auto rounded = hn::BitCast(bits, hn::MulAdd(sums, scale, magic));
      hn::StoreU(hn::TruncateTo(low, rounded), low, reinterpret_cast<std::uint32_t*>(corners) + 3 * x);
    }
    hn::StoreU(sums, d, sum);
  }
  for (; x < texels; ++x)
    for (std::size_t c = 0; c < 3; ++c) {
      sum[c] += columns[3 * x + c];
      const double rounded = sum[c] * steps_in_one[c] + whole_number;
      corners[3 * x + c] =
          static_cast<std::int32_t>(static_cast<std::uint32_t>(std::bit_cast<std::uint64_t>(rounded)));
    }
}

}  // namespace refield::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace refield {

HWY_EXPORT(add_row_vectorised);
HWY_EXPORT(prefix_row_vectorised);

namespace {

constexpr int strip_rows = 64;

/// No box comes to more steps; a little is left for rounding of the total.
constexpr double largest_sum = 2147483000.0;

/// Σ |texels|, a channel each.
void add_magnitude(std::span<const float> texels, std::array<double, 3>& magnitude) {
  for (std::size_t i = 0; i < texels.size(); i += 3)
    for (std::size_t c = 0; c < 3; ++c) magnitude[c] += std::abs(texels[i + c]);
}

}  // namespace

void FixedPointTable::sum(std::span<const SmallBox> boxes, float* sums) const {
  sum_boxes_fixed(corners_.data(), stride(), step_.data(), boxes.data(), boxes.size(), sums);
}

void FixedPointTable::build(const Image& light) {
  if (light.channels != 3 || light.empty())
    throw InputError("a summed-area table needs an RGB image, not one of ", shape_text(light));
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
    float minimum = 0.0f;
    for (int y = strip * strip_rows; y < last_row(strip); ++y)
      minimum =
          std::min(minimum, HWY_DYNAMIC_DISPATCH(add_row_vectorised)(light.row(y).data(), values, sums));
    auto& of_strip = magnitude[static_cast<std::size_t>(strip)];
    if (minimum < 0.0f)
      for (int y = strip * strip_rows; y < last_row(strip); ++y) add_magnitude(light.row(y), of_strip);
    else
      for (std::size_t i = 0; i < values; ++i) of_strip[i % 3] += sums[i];
  });
  double total[3] = {0.0, 0.0, 0.0};
  for (const auto& strip : magnitude)
    for (std::size_t c = 0; c < 3; ++c) total[c] += strip[c];
  for (int strip = 0; strip < strips; ++strip) {
    const double* above = columns_.data() + values * static_cast<std::size_t>(strip);
    double* sums = columns_.data() + values * static_cast<std::size_t>(strip + 1);
    for (std::size_t i = 0; i < values; ++i) sums[i] += above[i];
  }
  double steps_in_one[4] = {0.0, 0.0, 0.0, 0.0};
  for (int c = 0; c < 3; ++c) {
    const double step = total[c] > 0.0 ? total[c] / largest_sum : 1.0;
    step_[static_cast<std::size_t>(c)] = static_cast<float>(step);
    steps_in_one[c] = 1.0 / step;
  }

  std::fill_n(corners_.begin(), static_cast<std::size_t>(stride()) * 3, 0);
  tbb::parallel_for(0, strips, [&](int strip) {
    double* columns = columns_.data() + values * static_cast<std::size_t>(strip);
    for (int y = strip * strip_rows; y < last_row(strip); ++y) {
      HWY_DYNAMIC_DISPATCH(add_row_vectorised)(light.row(y).data(), values, columns);
      std::int32_t* corner = corners_.data() + static_cast<std::size_t>(y + 1) * stride() * 3;
      std::fill_n(corner, 3, 0);
      HWY_DYNAMIC_DISPATCH(prefix_row_vectorised)
      (columns, static_cast<std::size_t>(light.width), steps_in_one, corner + 3);
    }
  });
}

}  // namespace refield
#endif
