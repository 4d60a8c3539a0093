// SPDX-License-Identifier: Apache-2.0
#include "core/field/reflectance_field.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <fstream>
#include <memory>

#include "core/base/errors.h"
#include "core/base/rng.h"
#include "tests/support/temporary_folder.h"

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

TEST(FileVector, GrowsByZerosBehindTheValuesOfItsFile) {
  const test::TemporaryFolder folder;
  const std::vector<float> written = {1.0f, 2.0f, 3.0f};
  std::ofstream(folder / "values", std::ios::binary)
      .write(reinterpret_cast<const char*>(written.data()), sizeof(float) * written.size());
  const auto file = std::make_shared<const MappedFile>(folder / "values");
  FileVector<float> values(3, FileAllocator<float>(file, file->bytes()));
  EXPECT_EQ(static_cast<const void*>(values.data()), file->bytes().data());
  // Memory of the new size that holds other numbers before.
  { const FileVector<float> used(4096, 7.0f); }
  values.resize(4096);
  for (std::size_t i = 0; i < values.size(); ++i) ASSERT_EQ(values[i], i < 3 ? written[i] : 0.0f);
}

}  // namespace
}  // namespace refield
