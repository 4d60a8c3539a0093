// SPDX-License-Identifier: Apache-2.0
#include "estimate/rig/camera_path.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/base/linear_algebra.h"

namespace refield {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// More jumps than that are a walk.
constexpr int max_jumps = 8;
/// Photographs between jumps, at least: one photograph that does not fit is no jump.
constexpr Index min_stretch = 3;
/// Variances of a walk's step that are tried, over that of the measurements, as powers of ten.
constexpr double min_log_step = -4.0, max_log_step = 2.0, log_step_width = 0.25;

struct Candidate {
  CapturePath path;
  double score = std::numeric_limits<double>::infinity();
};

/// Measurements of components with the same standard deviation, and their criterion.
class PathChoice {
 public:
  PathChoice(const MatrixXd& measured, const VectorXd& variance, std::span<const int> at, int photographs,
             double floor)
      : measured_(measured), at_(at), photographs_(photographs), floor_(floor) {
    // Relative to the median measurement; none counts for more than four of it.
    std::vector<double> ordered(variance.data(), variance.data() + variance.size());
    std::ranges::sort(ordered);
    const double typical = ordered[ordered.size() / 2];
    variance_ = (variance / typical).cwiseMax(0.25);
  }

  /// Minus twice the logarithm of the likelihood, and the penalty; `log_determinant` of the measurements'
  /// covariance over its scale.
  double score(double squared, double parameters, double log_determinant = 0.0) const {
    const auto count = static_cast<double>(measured_.size());
    const double variance = std::max(squared / count, floor_ * floor_);
    return squared / variance + count * std::log(variance) + log_determinant + parameters * std::log(count);
  }

  /// Least squares by `columns`, functions of the photograph's number.
  template <class Column>
  Candidate fit(CapturePath::Kind kind, const std::vector<Column>& columns, double parameters) const {
    MatrixXd design(measured_.rows(), static_cast<Index>(columns.size()));
    MatrixXd all(photographs_, design.cols());
    for (Index k = 0; k < design.cols(); ++k) {
      for (Index i = 0; i < design.rows(); ++i) design(i, k) = columns[k](at_[i]);
      for (int j = 0; j < photographs_; ++j) all(j, k) = columns[k](j);
    }
    const VectorXd weights = variance_.cwiseSqrt().cwiseInverse();
    const MatrixXd coefficients =
        solve_least_squares(weights.asDiagonal() * design, weights.asDiagonal() * measured_);
    Candidate candidate;
    candidate.path.kind = kind;
    candidate.path.values = all * coefficients;
    const double squared = weighted_square(measured_ - design * coefficients);
    candidate.path.scatter = std::sqrt(squared / static_cast<double>(measured_.size()));
    candidate.score = score(squared, parameters);
    return candidate;
  }

  Candidate rest() const { return fit(CapturePath::Kind::rest, Columns{constant}, components()); }
  Candidate line() const {
    return fit(CapturePath::Kind::line, Columns{constant, [](int j) { return static_cast<double>(j); }},
               2.0 * components());
  }

  /// Adds the jump that explains most, as long as it pays.
  Candidate jumps() const {
    Candidate best;
    Columns columns{constant};
    std::vector<int> found;
    for (int count = 1; count <= max_jumps; ++count) {
      const int next = best_jump(found);
      if (next < 0) break;
      found.push_back(next);
      columns.emplace_back([next](int j) { return j >= next ? 1.0 : 0.0; });
      Candidate candidate =
          fit(CapturePath::Kind::jumps, columns, components() + count * (components() + 1.0));
      candidate.path.jumps = found;
      std::ranges::sort(candidate.path.jumps);
      if (candidate.score < best.score) best = std::move(candidate);
    }
    return best;
  }

  Candidate walk() const {
    Candidate best;
    for (double log_step = min_log_step; log_step <= max_log_step; log_step += log_step_width) {
      Candidate candidate = walk_of(std::pow(10.0, log_step));
      if (candidate.score < best.score) best = std::move(candidate);
    }
    return best;
  }

 private:
  using Columns = std::vector<std::function<double(int)>>;
  static double constant(int) { return 1.0; }
  double weighted_square(const MatrixXd& residual) const {
    return (residual.rowwise().squaredNorm().array() / variance_.array()).sum();
  }
  double components() const { return static_cast<double>(measured_.cols()); }

  /// The first photograph after the jump that leaves the least residual, beside those found; −1: none.
  int best_jump(const std::vector<int>& found) const {
    // Between jumps each stretch has its mean: a new jump splits one of them.
    std::vector<int> ends = found;
    ends.push_back(std::numeric_limits<int>::max());
    std::ranges::sort(ends);
    int best = -1;
    double best_gain = 0.0;
    Index first = 0;
    for (const int end : ends) {
      Index last = first;
      while (last < measured_.rows() && at_[last] < end) ++last;
      Eigen::RowVectorXd all = Eigen::RowVectorXd::Zero(measured_.cols()), before = all;
      double weight = 0.0, left = 0.0;
      for (Index i = first; i < last; ++i) {
        all += measured_.row(i) / variance_[i];
        weight += 1.0 / variance_[i];
      }
      for (Index i = first + 1; i <= last - min_stretch; ++i) {
        before += measured_.row(i - 1) / variance_[i - 1];
        left += 1.0 / variance_[i - 1];
        if (i - first < min_stretch) continue;
        const double gain = before.squaredNorm() / left + (all - before).squaredNorm() / (weight - left) -
                            all.squaredNorm() / weight;
        if (gain <= best_gain) continue;
        best_gain = gain;
        best = at_[i];
      }
      first = last;
    }
    return best;
  }

  /// Local level model: the level's step has `step` times the variance of a measurement.
  Candidate walk_of(double step) const {
    const Index count = measured_.rows();
    VectorXd variance(count), predicted_variance(count);
    MatrixXd level(count, measured_.cols());
    double squared = 0.0, log_determinant = 0.0;
    level.row(0) = measured_.row(0);  // nothing is known before
    variance[0] = variance_[0];
    for (Index i = 1; i < count; ++i) {
      predicted_variance[i] = variance[i - 1] + step * (at_[i] - at_[i - 1]);
      const Eigen::RowVectorXd innovation = measured_.row(i) - level.row(i - 1);
      const double of_innovation = predicted_variance[i] + variance_[i];
      squared += innovation.squaredNorm() / of_innovation;
      log_determinant += std::log(of_innovation) * components();
      const double gain = predicted_variance[i] / of_innovation;
      level.row(i) = level.row(i - 1) + gain * innovation;
      variance[i] = predicted_variance[i] * (1.0 - gain);
    }
    for (Index i = count - 2; i >= 0; --i)  // smoothed backwards
      level.row(i) += variance[i] / predicted_variance[i + 1] * (level.row(i + 1) - level.row(i));
    Candidate candidate;
    candidate.path.kind = CapturePath::Kind::walk;
    candidate.path.values.resize(photographs_, measured_.cols());
    for (int j = 0, i = 0; j < photographs_;
         ++j) {  // photographs that were not measured: as the nearest before
      while (i + 1 < count && at_[i + 1] <= j) ++i;
      candidate.path.values.row(j) = level.row(i);
    }
    candidate.path.scatter =
        std::sqrt(weighted_square(measured_ - level) / static_cast<double>(measured_.size()));
    candidate.score = score(squared, components() + 1.0, log_determinant);
    return candidate;
  }

  const MatrixXd& measured_;
  std::span<const int> at_;
  int photographs_;
  double floor_;
  VectorXd variance_;  // relative
};

}  // namespace

CapturePath choose_path(const MatrixXd& measured, const VectorXd& variance, std::span<const int> at,
                        int photographs, double floor) {
  const PathChoice choice(measured, variance, at, photographs, floor);
  Candidate best = choice.rest();
  for (Candidate candidate : {choice.line(), choice.jumps(), choice.walk()})
    if (candidate.score < best.score) best = std::move(candidate);
  const Eigen::RowVectorXd first = best.path.values.row(0);
  best.path.values.rowwise() -= first;
  if (best.path.kind == CapturePath::Kind::rest) best.path.values.setZero();
  return best.path;
}

}  // namespace refield
