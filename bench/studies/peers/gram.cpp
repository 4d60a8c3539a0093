// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/peers/gram.h"

#include <Eigen/Core>
#include <cmath>
#include <limits>

#include "core/base/linear_algebra.h"

namespace refield::peers {

namespace {

// Directions below this share of the largest eigenvalue are rounding alone.
constexpr double smallest_relative_value = 1e-12;

DualFilters& fill_truncation(DualFilters& filters, const GramSpectrum& spectrum) {
  const Eigen::Index n = spectrum.values.size();
  const double floor = smallest_relative_value * spectrum.values(0);
  filters.factors = Eigen::MatrixXd::Zero(n, n);  // ranks 0 to n − 1
  filters.misfit = Eigen::MatrixXd::Zero(n, n);
  filters.denominator.resize(n);
  for (Eigen::Index rank = 0; rank < n; ++rank) {
    for (Eigen::Index i = 0; i < n; ++i)
      if (i < rank && spectrum.values(i) > floor)
        filters.factors(i, rank) = 1.0 / spectrum.values(i);
      else
        filters.misfit(rank, i) = 1.0;
    const auto left = static_cast<double>(n - rank);
    filters.denominator(rank) = left * left;
  }
  return filters;
}

DualFilters& fill_ridge(DualFilters& filters, const GramSpectrum& spectrum) {
  const Eigen::Index n = spectrum.values.size();
  const bool by_likelihood = filters.method == DualMethod::smooth_ridge;
  filters.factors.resize(n, penalties);
  filters.misfit.resize(penalties, n);
  filters.denominator.resize(penalties);
  for (Eigen::Index setting = 0; setting < penalties; ++setting) {
    const double lambda = penalty(spectrum, setting);
    const Eigen::ArrayXd inverse = (spectrum.values.array() + lambda).inverse();
    filters.factors.col(setting) = inverse;
    if (by_likelihood) {
      filters.misfit.row(setting) = inverse;
      filters.denominator(setting) = -inverse.log().sum();
    } else {
      filters.misfit.row(setting) = (lambda * inverse).square();
      const double trace = (lambda * inverse).sum();
      filters.denominator(setting) = trace * trace;
    }
  }
  return filters;
}

}  // namespace

GramSpectrum::GramSpectrum(const Eigen::MatrixXd& gram) {
  const SymmetricEigen solver = symmetric_eigen(gram);
  values = solver.values.reverse().cwiseMax(0.0);
  // A light without this channel leaves nothing to divide by; any scale will do.
  if (values(0) == 0.0) values(0) = std::numeric_limits<double>::min();
  vectors = solver.vectors.rowwise().reverse();
}

double penalty(const GramSpectrum& spectrum, Eigen::Index setting) {
  return spectrum.values(0) * std::pow(10.0, 0.25 * static_cast<double>(setting) - 9.0);
}

DualFilters::DualFilters(const GramSpectrum& spectrum, DualMethod dual_method) : method(dual_method) {
  if (method == DualMethod::truncated_svd)
    fill_truncation(*this, spectrum);
  else
    fill_ridge(*this, spectrum);
}

Eigen::VectorXd DualFilters::criterion(const Eigen::Ref<const Eigen::VectorXd>& squared) const {
  const auto n = static_cast<double>(squared.size());
  const Eigen::ArrayXd weighted = misfit * squared;
  if (method == DualMethod::smooth_ridge)
    return n * weighted.max(std::numeric_limits<double>::min()).log() + denominator.array();
  return n * weighted / denominator.array();
}

}  // namespace refield::peers
