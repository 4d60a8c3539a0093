// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>

#include "core/base/aligned_memory.h"
#include "core/image/image.h"
#include "core/light/light_map.h"

namespace refield {

/// Sums of an RGB image over any rectangle in constant time (Crow 1984).
/// Kept in double: a float32 table is off by 30 % on single texels of an ordinary 800×600 map, because a box
/// sum is a small difference of large prefix sums.
class SummedAreaTable {
 public:
  SummedAreaTable() = default;
  explicit SummedAreaTable(const Image& image) { build(image); }

  /// Tabulates `image`, 3 channels; memory is kept from one image to the next. Runs on all cores. Throws
  /// InputError for other images.
  void build(const Image& image);

  int width() const { return width_; }
  int height() const { return height_; }

  /// Sum of the texel values in `box`, a channel each. `box` must lie inside the image (not checked here: hot
  /// loop).
  std::array<double, 3> sum(const Box& box) const {
    const double* a = corner(box.x0, box.y0);
    const double* b = corner(box.x1, box.y0);
    const double* c = corner(box.x0, box.y1);
    const double* d = corner(box.x1, box.y1);
    return {(d[0] - c[0]) - (b[0] - a[0]), (d[1] - c[1]) - (b[1] - a[1]), (d[2] - c[2]) - (b[2] - a[2])};
  }

 private:
  const double* corner(int x, int y) const {
    return prefix_.data() + (static_cast<std::size_t>(y) * (width_ + 1) + x) * 3;
  }
  int width_ = 0;
  int height_ = 0;
  AlignedDoubles prefix_;  // [at least (height+1) × (width+1) × 3], first row and column zero
};

}  // namespace refield
