// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/low_rank.h"

#include <tbb/parallel_for.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace refield::dynamic {

namespace {

constexpr float largest_whole = 32767.0f;

/// Σ columns · columnsᵀ, in double over pieces that float holds well.
Eigen::MatrixXd gram_of(const Eigen::MatrixXf& rows) {
  constexpr Eigen::Index piece = 4096;
  Eigen::MatrixXd gram = Eigen::MatrixXd::Zero(rows.rows(), rows.rows());
  for (Eigen::Index first = 0; first < rows.cols(); first += piece) {
    const auto part = rows.middleCols(first, std::min(piece, rows.cols() - first));
    gram += (part * part.transpose()).cast<double>();
  }
  return gram;
}

}  // namespace

ModeWeights LowRank::modes_of(const ModeWeights& weights) const {
  ModeWeights z(rank, 3);
  for (Eigen::Index c = 0; c < 3; ++c)
    z.col(c) = mix.middleCols(c * weights.rows(), weights.rows()) * weights.col(c);
  return z;
}

void LowRank::expand(std::size_t block, const ModeWeights& z, float* out) const {
  const std::int16_t* value = values.data() + block * static_cast<std::size_t>(rank * width);
  std::fill_n(out, 3 * width, 0.0f);
  float *red = out, *green = out + width, *blue = out + 2 * width;
  for (int r = 0; r < rank; ++r, value += width) {
    const float z0 = z(r, 0), z1 = z(r, 1), z2 = z(r, 2);
    for (int i = 0; i < width; ++i) {
      const auto u = static_cast<float>(value[i]);
      red[i] += z0 * u;
      green[i] += z1 * u;
      blue[i] += z2 * u;
    }
  }
  for (int i = 0; i < 3 * width; ++i) out[i] *= scale[block];
}

std::size_t LowRank::bytes() const {
  return values.size() * sizeof(std::int16_t) + scale.size() * sizeof(float) +
         static_cast<std::size_t>(mix.size()) * sizeof(float);
}

LowRank low_rank(const Eigen::MatrixXf& rows, int width, const Eigen::VectorXf& strength, double error) {
  LowRank result;
  result.width = width;
  result.blocks = static_cast<std::size_t>(rows.cols() / width);
  const Eigen::MatrixXd weighted = strength.cast<double>().asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(weighted * gram_of(rows) * weighted);
  const Eigen::VectorXd energy = solver.eigenvalues().reverse().cwiseMax(0.0);  // the largest first
  // Float cannot tell less from nothing: an error of 3e-4.
  const double all = energy.sum(), least = all * 1e-7;
  double left = all;
  while (result.rank < energy.size() && left > std::max(error * error * all, least))
    left -= energy[result.rank++];
  result.error = all > 0.0 ? std::sqrt(std::max(left, 0.0) / all) : 0.0;

  const Eigen::MatrixXd vectors = solver.eigenvectors().rowwise().reverse().leftCols(result.rank);
  // M ≈ (M S V) (Vᵀ S⁻¹); a column without strength is multiplied with nothing.
  const Eigen::VectorXd inverse =
      (strength.array() > 0.0f).select(strength.array().inverse(), 0.0f).cast<double>();
  result.mix = (vectors.transpose() * inverse.asDiagonal()).cast<float>();
  const Eigen::MatrixXf to_modes = (vectors.transpose() * weighted).cast<float>();
  result.scale.assign(result.blocks, 0.0f);
  result.values.assign(result.blocks * static_cast<std::size_t>(width * result.rank), 0);
  if (result.rank == 0) return result;
  tbb::parallel_for(std::size_t{0}, result.blocks, [&](std::size_t block) {
    const Eigen::MatrixXf modes =
        to_modes * rows.middleCols(static_cast<Eigen::Index>(block) * width, width);  // [rank × width]
    const float largest = modes.cwiseAbs().maxCoeff();
    if (!(largest > 0.0f)) return;
    result.scale[block] = largest / largest_whole;
    std::int16_t* value = result.values.data() + block * static_cast<std::size_t>(result.rank * width);
    for (int r = 0; r < result.rank; ++r)
      for (int i = 0; i < width; ++i)
        *value++ = static_cast<std::int16_t>(std::lround(modes(r, i) / result.scale[block]));
  });
  return result;
}

}  // namespace refield::dynamic
