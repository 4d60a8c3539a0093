// SPDX-License-Identifier: Apache-2.0
#include "core/transfer_matrix.h"

#include <tbb/parallel_for.h>

#include "core/errors.h"

namespace refield {

void SparseTransfer::append_row(std::span<const std::uint32_t> columns, std::span<const float> weights) {
  if (weights.size() != columns.size() * 3) throw InputError("a transfer row needs three weights an entry");
  column.insert(column.end(), columns.begin(), columns.end());
  weight.insert(weight.end(), weights.begin(), weights.end());
  row_start.push_back(column.size());
}

void SparseTransfer::apply(std::span<const float> coefficients, std::span<float> outputs) const {
  if (outputs.size() != rows() * 3) throw InputError("transfer: three outputs a row are needed");
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, rows(), 1024), [&](const auto& range) {
    for (std::size_t row = range.begin(); row != range.end(); ++row) {
      float sum[3] = {0.0f, 0.0f, 0.0f};
      for (std::uint64_t e = row_start[row]; e != row_start[row + 1]; ++e) {
        const float* light = coefficients.data() + std::size_t{3} * column[e];
        for (int c = 0; c < 3; ++c) sum[c] += weight[3 * e + c] * light[c];
      }
      for (int c = 0; c < 3; ++c) outputs[3 * row + c] = sum[c];
    }
  });
}

}  // namespace refield
