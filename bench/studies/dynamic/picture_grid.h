// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <algorithm>
#include <vector>

#include "core/image/image.h"

namespace refield::dynamic_chart {

/// Pictures of three channels and one size in rows of `columns`.
inline Image picture_grid(const std::vector<Image>& pictures, int columns) {
  const int width = pictures.front().width, height = pictures.front().height;
  const int rows = (static_cast<int>(pictures.size()) + columns - 1) / columns;
  Image grid(columns * width, rows * height, 3);
  for (std::size_t p = 0; p < pictures.size(); ++p) {
    const int left = static_cast<int>(p) % columns * width, top = static_cast<int>(p) / columns * height;
    for (int y = 0; y < height; ++y)
      std::ranges::copy(pictures[p].row(y),
                        grid.row(top + y).subspan(3 * static_cast<std::size_t>(left)).begin());
  }
  return grid;
}

}  // namespace refield::dynamic_chart
