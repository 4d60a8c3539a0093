// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/image/tone_map.h"

namespace refield {

/// The table of the mapping asked for last: making one takes as long as mapping half a million values.
class ToneTableCache {
 public:
  const LevelTable& table(const ToneMapping& mapping) {
    if (mapping != mapping_) table_ = LevelTable(mapping_ = mapping);
    return table_;
  }

 private:
  ToneMapping mapping_;
  LevelTable table_{mapping_};
};

}  // namespace refield
