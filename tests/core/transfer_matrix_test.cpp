// SPDX-License-Identifier: Apache-2.0
#include "core/field/transfer_matrix.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include "core/base/errors.h"
#include "core/base/rng.h"

namespace refield {
namespace {

SparseTransfer random_transfer(Rng& rng, int rows, int functions, int max_entries) {
  SparseTransfer transfer;
  for (int row = 0; row < rows; ++row) {
    std::vector<std::uint32_t> columns(rng.below(max_entries + 1));
    std::vector<float> weights(columns.size() * 3);
    for (auto& column : columns) column = static_cast<std::uint32_t>(rng.below(functions));
    for (auto& weight : weights) weight = static_cast<float>(rng.uniform());
    transfer.append_row(columns, weights);
  }
  return transfer;
}

std::vector<float> random_coefficients(Rng& rng, int functions) {
  std::vector<float> coefficients(3 * functions);
  for (float& c : coefficients) c = static_cast<float>(rng.uniform(0.0, 100.0));
  return coefficients;
}

TEST(SparseTransfer, EqualsTheDenseProduct) {
  Rng rng(1);
  constexpr int rows = 3000;  // more than one block of the parallel loop
  constexpr int functions = 50;
  const SparseTransfer transfer = random_transfer(rng, rows, functions, 25);
  const auto coefficients = random_coefficients(rng, functions);
  std::vector<float> outputs(3 * rows, -1.0f);
  transfer.apply(coefficients, outputs);
  for (int row = 0; row < rows; ++row)
    for (int c = 0; c < 3; ++c) {
      double expected = 0.0;
      for (auto e = transfer.row_start[row]; e < transfer.row_start[row + 1]; ++e)
        expected +=
            static_cast<double>(transfer.weight[3 * e + c]) * coefficients[3 * transfer.column[e] + c];
      constexpr double float_rounding = 25 * 6e-8;  // one rounding an entry, all terms positive
      ASSERT_NEAR(outputs[3 * row + c], expected, float_rounding * expected) << "row " << row;
    }
}

TEST(SparseTransfer, EmptyRowsGiveBlack) {
  SparseTransfer transfer;
  transfer.append_row({}, {});
  std::vector<float> outputs(3, 7.0f);
  transfer.apply({}, outputs);
  EXPECT_EQ(outputs, std::vector<float>(3, 0.0f));
}

TEST(SparseTransfer, DoesNotDependOnTheNumberOfThreads) {
  Rng rng(2);
  const SparseTransfer transfer = random_transfer(rng, 5000, 300, 25);
  const auto coefficients = random_coefficients(rng, 300);
  std::vector<float> parallel(3 * transfer.rows());
  std::vector<float> serial(3 * transfer.rows());
  transfer.apply(coefficients, parallel);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  transfer.apply(coefficients, serial);
  EXPECT_EQ(parallel, serial);
}

TEST(SparseTransfer, ChecksShapes) {
  SparseTransfer transfer;
  const std::uint32_t column = 0;
  const std::vector<float> two_weights(2);
  EXPECT_THROW(transfer.append_row({&column, 1}, two_weights), InputError);
  transfer.append_row({}, {});
  std::vector<float> outputs(6);
  EXPECT_THROW(transfer.apply({}, outputs), InputError);
}

}  // namespace
}  // namespace refield
