// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/file_vector.h"

namespace refield {

/// A sparse, non-negative transfer matrix by rows: outputs = transfer · coefficients.
/// One row an output (pixel or vertex); an entry holds a basis function's number and one weight a channel. A
/// weight multiplies the *sum* of texel values in its box.
struct SparseTransfer {
  std::vector<std::uint64_t> row_start{0};  ///< [rows + 1]
  FileVector<std::uint32_t> column;         ///< [entries], basis function
  FileVector<float> weight;                 ///< [entries × 3]

  std::size_t rows() const { return row_start.size() - 1; }
  std::size_t entries() const { return column.size(); }
  /// A copy of rows [first, last).
  SparseTransfer slice(std::size_t first, std::size_t last) const;
  /// Says that a pass is done with some rows, see pass_by().
  void pass_by_rows(std::size_t first, std::size_t last) const;

  /// Appends a row with `columns.size()` entries and `weights` [entries × 3].
  void append_row(std::span<const std::uint32_t> columns, std::span<const float> weights);

  /// `coefficients` [basis functions × 3] to `outputs` [rows × 3]. Runs on all cores; each output is summed
  /// in the order of its entries, so the result does not depend on the number of threads.
  void apply(std::span<const float> coefficients, std::span<float> outputs) const;
};

}  // namespace refield
