// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/object_transport.h"

#include <gtest/gtest.h>

#include "core/base/rng.h"

namespace refield::dynamic {
namespace {

constexpr int width = 9;
constexpr Eigen::Index columns = 12, blocks = 40;

Eigen::MatrixXf random(Eigen::Index rows, Eigen::Index cols, std::uint64_t seed) {
  Rng rng(seed);
  Eigen::MatrixXf matrix(rows, cols);
  for (Eigen::Index i = 0; i < matrix.size(); ++i) matrix.data()[i] = static_cast<float>(rng.normal());
  return matrix;
}

/// What a LowRank makes of weights, beside the product itself: relative error.
double error_of(const LowRank& low, const Eigen::MatrixXf& rows) {
  const ModeWeights weights = random(columns / 3, 3, 9);
  Eigen::VectorXf flat(columns);
  flat << weights.col(0), weights.col(1), weights.col(2);
  const ModeWeights z = low.modes_of(weights);
  double error = 0.0, energy = 0.0;
  for (Eigen::Index b = 0; b < blocks; ++b) {
    Eigen::MatrixXf out(width, 3);
    low.expand(static_cast<std::size_t>(b), z, out.data());
    for (Eigen::Index c = 0; c < 3; ++c) {
      const Eigen::VectorXf exact =
          rows.block(c * columns / 3, b * width, columns / 3, width).transpose() * weights.col(c);
      error += (out.col(c) - exact).squaredNorm();
      energy += exact.squaredNorm();
    }
  }
  return std::sqrt(error / energy);
}

TEST(LowRank, KeepsWhatHasFewModes) {
  const Eigen::MatrixXf rows = random(columns, 4, 1) * random(4, blocks * width, 2);
  const LowRank low = low_rank(rows, width);
  EXPECT_LE(low.rank, 5);                // 4, and the rounding of the product
  EXPECT_LT(error_of(low, rows), 4e-4);  // 16 bits
}

TEST(LowRank, LeavesOutWhatFloatCannotTellAlone) {
  const Eigen::MatrixXf rows = random(columns, blocks * width, 3);
  const LowRank low = low_rank(rows, width);
  EXPECT_EQ(low.rank, columns);
  EXPECT_LT(error_of(low, rows), 4e-4);
}

TEST(LowRank, OfNothingIsNothing) {
  const LowRank low = low_rank(Eigen::MatrixXf::Zero(columns, blocks * width), width);
  EXPECT_EQ(low.rank, 0);
  std::vector<float> out(3 * width, 1.0f);
  low.expand(3, low.modes_of(ModeWeights::Ones(columns / 3, 3)), out.data());
  for (const float value : out) EXPECT_EQ(value, 0.0f);
}

}  // namespace
}  // namespace refield::dynamic
