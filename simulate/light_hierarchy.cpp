// SPDX-License-Identifier: Apache-2.0
#include "simulate/light_hierarchy.h"

#include <algorithm>

namespace refield {

namespace {
constexpr int coarsest_share_of_width = 16;
}

LightHierarchy::LightHierarchy(const LightDomain& domain) : domain_(domain) {
  for (int level = 0; level == 0 || (1 << level) * coarsest_share_of_width <= domain.width; ++level) {
    const int side = 1 << level;
    levels_.push_back({size_, (domain.width + side - 1) / side, (domain.height + side - 1) / side});
    size_ += static_cast<std::uint32_t>(levels_.back().columns) * levels_.back().rows;
  }
}

Box LightHierarchy::box(int level, int column, int row) const {
  return {column << level, row << level, std::min((column + 1) << level, domain_.width),
          std::min((row + 1) << level, domain_.height)};
}

Box LightHierarchy::box(std::uint32_t node) const {
  int level = coarsest_level();
  while (levels_[level].first > node) --level;
  const auto within = static_cast<int>(node - levels_[level].first);
  return box(level, within % levels_[level].columns, within / levels_[level].columns);
}

}  // namespace refield
