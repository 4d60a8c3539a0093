// SPDX-License-Identifier: Apache-2.0
#include "core/light/summed_area_table.h"

#include <tbb/parallel_for.h>

#include <algorithm>

namespace refield {

void SummedAreaTable::build(const Image& image) {
  if (image.channels != 3 || image.empty())
    throw InputError("a summed-area table needs an RGB image, not one of ", shape_text(image));
  width_ = image.width;
  height_ = image.height;
  const std::size_t stride = static_cast<std::size_t>(width_ + 1) * 3;
  prefix_.resize(std::max(prefix_.size(), stride * static_cast<std::size_t>(height_ + 1)));
  std::fill_n(prefix_.begin(), stride, 0.0);
  tbb::parallel_for(0, height_, [&](int y) {
    const float* source = image.row(y).data();
    double* row = prefix_.data() + stride * static_cast<std::size_t>(y + 1);
    std::fill_n(row, 3, 0.0);
    for (int i = 0; i < 3 * width_; ++i) row[i + 3] = row[i] + source[i];
  });
  // Down the columns, some cache lines of each row at a time.
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, stride, 512), [&](const auto& columns) {
    for (int y = 1; y < height_; ++y) {
      const double* above = prefix_.data() + stride * static_cast<std::size_t>(y);
      double* row = prefix_.data() + stride * static_cast<std::size_t>(y + 1);
      for (std::size_t i = columns.begin(); i < columns.end(); ++i) row[i] += above[i];
    }
  });
}

}  // namespace refield
