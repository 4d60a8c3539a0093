// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <vector>

#include "core/image.h"
#include "core/transfer_tiles.h"

namespace refield {

/// Which texels a change of light changed: a lamp that moves leaves most of what it lit as it was.
class ChangedTexels {
 public:
  /// `difference`: new less old light, 3 channels; memory is kept from one to the next.
  void build(const Image& difference);

  /// Whether any texel in `box` changed; it must lie inside the difference.
  bool any(const SmallBox& box) const {
    if (counts_.empty()) return true;
    return counts_[place(box.x1, box.y1)] - counts_[place(box.x0, box.y1)] !=
           counts_[place(box.x1, box.y0)] - counts_[place(box.x0, box.y0)];
  }

 private:
  std::size_t place(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width_ + 1) + static_cast<std::size_t>(x);
  }
  int width_ = 0;
  std::vector<std::int32_t>
      counts_;  // summed-area table [(height + 1) × (width + 1)]; empty where all changed
};

}  // namespace refield
