// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <vector>

#include "core/box.h"
#include "core/light_map.h"

namespace refield {

/// The boxes that traced transport is made of: squares of 1, 2, 4, ... texels on a fixed grid over the light
/// map, those at its right and lower edge cut off there. Level 0 holds single texels; on the coarsest level
/// squares are no larger than a sixteenth of the map's width.
class LightHierarchy {
 public:
  explicit LightHierarchy(const LightDomain& domain);

  const LightDomain& domain() const { return domain_; }
  int coarsest_level() const { return static_cast<int>(levels_.size()) - 1; }
  int columns(int level) const { return levels_[level].columns; }
  int rows(int level) const { return levels_[level].rows; }
  /// Number of squares on all levels; they are numbered from 0, level by level.
  std::uint32_t size() const { return size_; }
  std::uint32_t node(int level, int column, int row) const {
    return levels_[level].first + static_cast<std::uint32_t>(row) * levels_[level].columns + column;
  }
  std::uint32_t node_of_texel(int level, int x, int y) const { return node(level, x >> level, y >> level); }
  Box box(int level, int column, int row) const;
  Box box(std::uint32_t node) const;

 private:
  struct Level {
    std::uint32_t first;
    int columns, rows;
  };
  LightDomain domain_;
  std::vector<Level> levels_;
  std::uint32_t size_ = 0;
};

}  // namespace refield
