// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/smooth_space.h"

#include <cmath>
#include <limits>

#include "core/base/linear_algebra.h"

namespace refield {

namespace {

/// Length over which transport by diffuse surfaces stays alike, as a part of the light map's width. Measured:
/// half the width is best on captures and on synthetic scenes; a quarter costs 5 %, the whole is as good.
constexpr double length_scale = 0.5;
/// Strongest first.
constexpr std::array<double, 4> noise_ratios = {1e-4, 1e-3, 1e-2, 1e-1};
/// Directions that even the strongest class leaves alone but for this part are left out.
constexpr double negligible = 1e-3;
constexpr int max_hats = 20;
/// Hats leave at least this part of a pixel's kernels to rectangles.
constexpr double max_hats_share = 0.8;

/// Covariance of the hats' weights.
Eigen::MatrixXd covariance(const HatGrid& grid, const LightDomain& domain) {
  const int n = grid.count();
  const double scale = std::sqrt(3.0) / (length_scale * std::max(domain.width, domain.height));
  const auto place = [&](int node) {
    const double x = grid.columns > 1 ? static_cast<double>(node % grid.columns) / (grid.columns - 1) : 0.5;
    const double y = grid.rows > 1 ? static_cast<double>(node / grid.columns) / (grid.rows - 1) : 0.5;
    return Eigen::Vector2d(x * domain.width, y * domain.height);
  };
  Eigen::MatrixXd C(n, n);
  for (int i = 0; i < n; ++i)
    for (int k = 0; k < n; ++k) {
      const double d = scale * (place(i) - place(k)).norm();
      C(i, k) = (1.0 + d) * std::exp(-d);
    }
  return C;
}

}  // namespace

HatGrid hat_grid_for(const LightDomain& domain, int kernels) {
  const int max_nodes = std::min(max_hats, static_cast<int>(max_hats_share * kernels));
  HatGrid best;
  double best_spacing = 0.0;
  for (int columns = 2; columns <= std::min(max_nodes / 2, domain.width); ++columns) {
    const int rows = std::min({max_nodes / columns, domain.height});
    if (rows < 2) continue;
    // The wider of the two distances between nodes decides how much detail is lost.
    const double spacing = std::max(static_cast<double>(domain.width) / (columns - 1),
                                    static_cast<double>(domain.height) / (rows - 1));
    if (best.count() == 0 || spacing < best_spacing) {
      best = {columns, rows};
      best_spacing = spacing;
    }
  }
  return best;
}

SmoothSpace::SmoothSpace(const BoxTable& table) : hats_(table.hats().count()), stride_(table.stride()) {
  rank_ = std::min(hats_, table.images());
  if (hats_ > 0) classes_.resize(noise_ratios.size());
  for (SmoothClass& smooth : classes_) smooth.smooth = true;
  classes_.emplace_back();
  for (int c = 0; c < 3; ++c) {
    for (SmoothClass& each : classes_) each.correction[c].assign(rank_, 0.0f);
    if (hats_ > 0) analyse(table, c);
  }
}

void SmoothSpace::analyse(const BoxTable& table, int c) {
  const int n = table.images();
  const Eigen::MatrixXd C = covariance(table.hats(), table.domain());
  const Eigen::LLT<Eigen::MatrixXd> cholesky(C);
  const Eigen::MatrixXd root = cholesky.matrixL();
  const Eigen::MatrixXd identity = Eigen::MatrixXd::Identity(hats_, hats_);
  const Eigen::MatrixXd inverse = cholesky.solve(identity);
  Eigen::MatrixXd H(n, hats_);
  for (int k = 0; k < hats_; ++k)
    for (int j = 0; j < n; ++j) H(j, k) = table.hat_sums(k, c)[j];
  hat_columns_[c].assign(static_cast<std::size_t>(hats_) * stride_, 0.0f);
  for (int k = 0; k < hats_; ++k)
    for (int j = 0; j < n; ++j) hat_columns_[c][k * stride_ + j] = static_cast<float>(H(j, k));
  const Eigen::MatrixXd gram = H.transpose() * H;
  hat_gram_[c].assign(gram.data(), gram.data() + gram.size());

  // H·root = V √(w·mean) Rᵀ from the eigenvectors of its Gram matrix; w in units of the mean variance that
  // the smooth part causes in an image.
  const Eigen::MatrixXd M = H * root;
  const double mean = std::max(M.squaredNorm() / n, std::numeric_limits<double>::min());
  const SymmetricEigen eigen = symmetric_eigen(M.transpose() * M / mean);
  const Eigen::MatrixXd back = root.triangularView<Eigen::Lower>().solve(identity).transpose();
  directions_[c].assign(static_cast<std::size_t>(rank_) * stride_, 0.0f);
  to_hats_[c].assign(static_cast<std::size_t>(hats_) * rank_, 0.0);
  for (int k = 0; k < rank_; ++k) {
    const int column = hats_ - 1 - k;  // the solver sorts upwards
    const double w = eigen.values[column];
    if (!(w > negligible * noise_ratios.front())) break;
    const Eigen::VectorXd r = eigen.vectors.col(column);
    const Eigen::VectorXd v = M * r / std::sqrt(w * mean);
    for (int j = 0; j < n; ++j) directions_[c][k * stride_ + j] = static_cast<float>(v[j]);
    const Eigen::VectorXd to = back * r * std::sqrt(w * mean);  // Hᵀ = root⁻ᵀ R √(w·mean) Vᵀ
    for (int h = 0; h < hats_; ++h) to_hats_[c][static_cast<std::size_t>(h) * rank_ + k] = to[h];
    for (std::size_t i = 0; i < noise_ratios.size(); ++i) {
      classes_[i].correction[c][k] = static_cast<float>(-w / (w + noise_ratios[i]));
      classes_[i].log_determinant += std::log1p(w / noise_ratios[i]);
    }
  }
  for (std::size_t i = 0; i < noise_ratios.size(); ++i) {
    const Eigen::MatrixXd penalty = noise_ratios[i] * mean * inverse;
    classes_[i].penalty[c].assign(penalty.data(), penalty.data() + penalty.size());
  }
}

void SmoothSpace::project(const float* vector, int channel, float* coordinates) const {
  if (rank_ == 0) return;
  std::array<const float*, max_hats> V;
  for (int k = 0; k < rank_; ++k) V[k] = directions_[channel].data() + k * stride_;
  dots(vector, V.data(), rank_, stride_, coordinates);
  std::fill(coordinates + rank_, coordinates + padded_length(rank_), 0.0f);
}

void SmoothSpace::hat_products(const float* coordinates, int channel, double* products) const {
  for (int h = 0; h < hats_; ++h) {
    const double* row = to_hats_[channel].data() + static_cast<std::size_t>(h) * rank_;
    double sum = 0.0;
    for (int k = 0; k < rank_; ++k) sum += row[k] * coordinates[k];
    products[h] = sum;
  }
}

}  // namespace refield
