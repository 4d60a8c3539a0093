// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <cstdint>
#include <vector>

#include "core/base/aligned_memory.h"
#include "core/image/image.h"

namespace refield {

/// A summed-area table of 32-bit whole numbers: half the bytes of one in double, which matters because boxes
/// are looked up all over it. Prefix sums are rounded to steps of 2⁻³¹ of the light's total (of its
/// magnitude, where it has negative parts) and wrap around at 2³²; differences of wrapped numbers are exact,
/// and no box holds more than the total. So the sum over a box is off by at most two steps, 1e-9 of all
/// light, however it is spread: little beside any box of a map of up to some million texels, and worse than a
/// table in double for larger ones.
class FixedPointTable {
 public:
  /// Tabulates `light`, 3 channels; memory is kept from one light to the next. Runs on all cores.
  void build(const Image& light);

  /// Corner (x, y) of the table, x in [0, width], y in [0, height], is at 3 · (y · stride() + x);
  /// one number more may be read behind the last.
  const std::int32_t* corners() const { return corners_.data(); }
  std::int32_t stride() const { return width_ + 1; }
  /// What one step is worth, a channel each.
  const std::array<float, 4>& step() const { return step_; }

 private:
  int width_ = 0;
  std::vector<std::int32_t, AlignedAllocator<std::int32_t>> corners_;
  std::vector<double> columns_;  // sums of each strip's columns
  std::array<float, 4> step_ = {0.0f, 0.0f, 0.0f, 0.0f};
};

}  // namespace refield
