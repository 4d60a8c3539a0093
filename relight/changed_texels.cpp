// SPDX-License-Identifier: Apache-2.0
#include "relight/changed_texels.h"

#include <algorithm>

namespace refield {

void ChangedTexels::build(const Image& difference) {
  width_ = difference.width;
  counts_.clear();
  const auto changed = [](const float* texel) {
    return texel[0] != 0.0f || texel[1] != 0.0f || texel[2] != 0.0f;
  };
  std::size_t same = 0;
  for (std::size_t i = 0; i < difference.values.size(); i += 3) same += !changed(&difference.values[i]);
  if (same == 0) return;
  counts_.resize(place(0, difference.height + 1), 0);
  for (int y = 0; y < difference.height; ++y) {
    const float* texel = difference.row(y).data();
    const std::int32_t* above = counts_.data() + place(1, y);
    std::int32_t* counts = counts_.data() + place(1, y + 1);
    std::int32_t in_row = 0;
    for (int x = 0; x < width_; ++x, texel += 3) {
      in_row += changed(texel);
      counts[x] = above[x] + in_row;
    }
  }
}

}  // namespace refield
