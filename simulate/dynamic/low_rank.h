// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace refield::dynamic {

/// [rank × 3]: what the modes of a LowRank are multiplied with, RGB.
using ModeWeights = Eigen::Matrix<float, Eigen::Dynamic, 3>;

/// A large matrix [blocks · width × columns] in few modes: U · mix, U [blocks · width × rank] as whole
/// numbers of 16 bits with one scale a block, since what stands near an object is so much brighter than what
/// stands far.
struct LowRank {
  std::size_t blocks = 0;
  int width = 0, rank = 0;
  std::vector<std::int16_t> values;  ///< [blocks × rank × width]
  std::vector<float> scale;          ///< [blocks]
  Eigen::MatrixXf mix;               ///< [rank × columns]
  double error = 0.0;                ///< relative, of all elements, by what was left out

  /// z of weights [columns / 3 × 3], one colour for each third of the columns.
  ModeWeights modes_of(const ModeWeights& weights) const;
  /// out [width × 3] of a block for the modes' coefficients `z` [rank × 3].
  void expand(std::size_t block, const ModeWeights& z, float* out) const;
  std::size_t bytes() const;
};

/// The fewest modes that leave no more than `error` of the matrix out (relative, Frobenius' norm; 0: all that
/// can be told from zero, 3e-4). `rows` [columns × blocks · width]: one column of it for each row of the
/// matrix. The matrix' columns are weighted by `strength` [columns] when errors are counted: by how large the
/// numbers are that it will be multiplied with.
LowRank low_rank(const Eigen::MatrixXf& rows, int width, const Eigen::VectorXf& strength, double error);

}  // namespace refield::dynamic
