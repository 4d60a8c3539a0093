// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace refield {

/// Rows [first, last) of an image, counted from the top.
struct RowRange {
  int first = 0;
  int last = 0;

  int count() const { return last - first; }
  bool operator==(const RowRange&) const = default;
};

}  // namespace refield
