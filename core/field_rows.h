// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>

#include "core/reflectance_field.h"
#include "core/row_range.h"

namespace refield {

/// A field whose transfer is too large to stand in rows as a whole: it is asked for some image rows at a
/// time.
struct FieldRows {
  ReflectanceField outline;  ///< all but the transfer
  /// The transfer of some rows of the image, pixel by pixel. May be called once for each range, ranges
  /// ascending.
  std::function<SparseTransfer(RowRange)> rows;
};

}  // namespace refield
