// SPDX-License-Identifier: Apache-2.0
#include "core/field/transfer_matrix.h"

#include <tbb/parallel_for.h>

#include <Eigen/Core>
#include <algorithm>

#include "core/base/errors.h"

namespace refield {

void SparseTransfer::append_row(std::span<const std::uint32_t> columns, std::span<const float> weights) {
  if (weights.size() != columns.size() * 3) throw InputError("a transfer row needs three weights an entry");
  column.insert(column.end(), columns.begin(), columns.end());
  weight.insert(weight.end(), weights.begin(), weights.end());
  row_start.push_back(column.size());
}

SparseTransfer SparseTransfer::slice(std::size_t first, std::size_t last) const {
  const auto from = static_cast<std::ptrdiff_t>(row_start[first]),
             to = static_cast<std::ptrdiff_t>(row_start[last]);
  SparseTransfer some;
  some.row_start.clear();
  for (std::size_t row = first; row <= last; ++row)
    some.row_start.push_back(row_start[row] - row_start[first]);
  some.column.assign(column.begin() + from, column.begin() + to);
  some.weight.assign(weight.begin() + 3 * from, weight.begin() + 3 * to);
  return some;
}

void SparseTransfer::pass_by_rows(std::size_t first, std::size_t last) const {
  pass_by(column, row_start[first], row_start[last]);
  pass_by(weight, 3 * row_start[first], 3 * row_start[last]);
}

void SparseTransfer::apply(std::span<const float> coefficients, std::span<float> outputs) const {
  if (outputs.size() != rows() * 3) throw InputError("transfer: three outputs a row are needed");
  // Memory bandwidth is the limit, so arithmetic must stay below it: the three channels are one vector of
  // four, and each weight is read together with its neighbour's first float, which meets a zero. Only the
  // last entry has none.
  std::vector<Eigen::Array4f> light(coefficients.size() / 3);
  for (std::size_t k = 0; k < light.size(); ++k)
    light[k] = {coefficients[3 * k], coefficients[3 * k + 1], coefficients[3 * k + 2], 0.0f};
  const std::uint64_t last = std::max<std::uint64_t>(entries(), 1) - 1;
  // Of values in a file, stretches of many pages.
  const std::size_t stretch = weight.get_allocator().is_mapped() ? 32768 : 1024;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, rows(), stretch), [&](const auto& range) {
    for (std::size_t row = range.begin(); row != range.end(); ++row) {
      Eigen::Array4f sum = Eigen::Array4f::Zero();
      const std::uint64_t end = row_start[row + 1];
      for (std::uint64_t e = row_start[row]; e < std::min(end, last); ++e)
        sum += Eigen::Map<const Eigen::Array4f>(weight.data() + 3 * e) * light[column[e]];
      if (row_start[row] <= last && last < end)
        sum += Eigen::Array4f(weight[3 * last], weight[3 * last + 1], weight[3 * last + 2], 0.0f) *
               light[column[last]];
      Eigen::Map<Eigen::Array3f>(outputs.data() + 3 * row) = sum.head<3>();
    }
    pass_by_rows(range.begin(), range.end());
  });
}

}  // namespace refield
