// SPDX-License-Identifier: Apache-2.0
#include "core/summed_area_table.h"

#include "core/errors.h"

namespace refield {

SummedAreaTable::SummedAreaTable(const Image& image) : width_(image.width), height_(image.height) {
  if (image.channels != 3 || image.empty())
    throw InputError("a summed-area table needs an RGB image, not one of " + shape_text(image));
  const std::size_t stride = static_cast<std::size_t>(width_ + 1) * 3;
  prefix_.assign(stride * (height_ + 1), 0.0);
  for (int y = 0; y < height_; ++y) {
    const auto source = image.row(y);
    const double* above = prefix_.data() + stride * y;
    double* current = prefix_.data() + stride * (y + 1);
    double run[3] = {0.0, 0.0, 0.0};
    for (int x = 0; x < width_; ++x)
      for (int c = 0; c < 3; ++c) {
        run[c] += source[3 * x + c];
        current[3 * (x + 1) + c] = above[3 * (x + 1) + c] + run[c];
      }
  }
}

}  // namespace refield
