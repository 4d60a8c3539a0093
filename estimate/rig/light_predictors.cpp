// SPDX-License-Identifier: Apache-2.0
#include "estimate/rig/light_predictors.h"

#include <cmath>
#include <numeric>

namespace refield {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::MatrixXf;
using Eigen::VectorXd;

/// Standard deviation of the blur, in parts of the map's width, and ridge, over the mean of the Gram matrix'
/// diagonal.
struct Way {
  double blur, ridge;
};
constexpr std::array<Way, LightPredictors::ways> all_ways{
    {{0.06, 1e-2}, {0.12, 1e-2}, {0.12, 1e-3}, {0.25, 1e-3}, {0.25, 3e-4}, {0.25, 1e-4}}};
/// Lights are seen at most so finely.
constexpr int coarse_columns = 20, coarse_rows = 15;
/// Lights differ where the squared sine of the angle between them is larger: those of cycles-b and of the
/// tabletop differ by .01 and more, copies that were rounded to 8 bits by less than 1e-5.
constexpr double same_light = 1e-4;

/// Sums `features` [cells × images] of a grid to at most coarse_columns × coarse_rows cells, and blurs them.
MatrixXd blurred(const MatrixXd& features, int columns, int rows, double blur) {
  const int to_columns = std::min(columns, coarse_columns), to_rows = std::min(rows, coarse_rows);
  const auto gather = [](int from, int to) {
    MatrixXd sums = MatrixXd::Zero(to, from);
    for (int i = 0; i < from; ++i) sums(i * to / from, i) = 1.0;
    return sums;
  };
  const MatrixXd across =
      blur_matrix(to_columns, std::max(0.5, blur * to_columns)) * gather(columns, to_columns);
  const MatrixXd down = blur_matrix(to_rows, std::max(0.5, blur * to_columns)) * gather(rows, to_rows);
  MatrixXd result(features.cols(), static_cast<Index>(to_columns) * to_rows);
  for (Index j = 0; j < features.cols(); ++j) {
    const Eigen::Map<const MatrixXd> map(features.col(j).data(), columns, rows);
    const MatrixXd of = across * map * down.transpose();
    result.row(j) = Eigen::Map<const VectorXd>(of.data(), of.size());
  }
  return result;
}

/// Whether two of the lights of length 1 [cells × images] are multiples of each other.
bool are_same(const MatrixXd& directions, int i, int j) {
  const double cosine = directions.col(i).dot(directions.col(j));
  return 1.0 - cosine * cosine < same_light;
}

/// Runs of at least two images after each other whose lights [cells × images] are multiples of each other.
std::vector<std::vector<int>> folds_of(const MatrixXd& lights) {
  const MatrixXd directions = lights.colwise().normalized();
  std::vector<std::vector<int>> folds;
  for (int first = 0, last; first < lights.cols(); first = last) {
    last = first + 1;
    while (last < lights.cols() && are_same(directions, first, last)) ++last;
    if (last - first < 2) continue;
    std::vector<int>& fold = folds.emplace_back(last - first);
    std::iota(fold.begin(), fold.end(), first);
  }
  return folds;
}

/// Number of lights [cells × images] of which none is a multiple of an earlier one in all channels.
int different(const LightFeatures& lights, const std::vector<int>& chosen) {
  std::vector<int> first;  // numbers among `chosen`
  std::array<MatrixXd, 3> directions;
  for (int c = 0; c < 3; ++c)
    directions[c] = MatrixXd(lights.of_channel[c][0](Eigen::all, chosen)).colwise().normalized();
  for (int j = 0; j < static_cast<int>(chosen.size()); ++j) {
    const auto is_same = [&](int i) {
      return std::ranges::all_of(directions,
                                 [&](const MatrixXd& of_channel) { return are_same(of_channel, i, j); });
    };
    if (std::ranges::none_of(first, is_same)) first.push_back(j);
  }
  return static_cast<int>(first.size());
}

/// Whether the mean cosine of two lights exceeds what neighbouring sources have in common: natural images
/// have 0.7 and more, designed patterns 0.5, sources of a light stage up to 0.05.
bool have_parts_in_common(const MatrixXd& lights) {
  constexpr double min_mean_cosine = 0.2;
  const double count = static_cast<double>(lights.cols());
  const MatrixXd directions = lights.colwise().normalized();
  return count > 1.0 &&
         directions.rowwise().sum().squaredNorm() - count > min_mean_cosine * count * (count - 1.0);
}

}  // namespace

LightPredictors::LightPredictors(const LightFeatures& lights, std::span<const int> chosen) : lights_(lights) {
  chosen_.assign(chosen.begin(), chosen.end());
  for (int c = 0; c < 3; ++c) folds_[c] = folds_of(lights.of_channel[c][0](Eigen::all, chosen_));
  different_lights_ = different(lights, chosen_);
  are_mixtures_ = std::ranges::any_of(std::array{0, 1, 2}, [&](int c) {
    return have_parts_in_common(lights.of_channel[c][0](Eigen::all, chosen_));
  });
  use(1);
}

void LightPredictors::use(std::size_t way) {
  if (way == way_) return;
  way_ = way;
  blur(0, 1);
  has_exponents_ = false;
}

void LightPredictors::prepare_exponents() {
  if (!has_exponents_) blur(1, 3);
  has_exponents_ = true;
}

MatrixXf LightPredictors::leave_one_out(int channel, double exponent, bool with_constant) const {
  const MatrixXd inverse = this->inverse(channel, exponent, with_constant);
  MatrixXd result = inverse.array().colwise() / inverse.diagonal().array();
  for (const auto& fold : folds_[channel]) {
    const MatrixXd of_fold = inverse(fold, fold), rows = inverse(fold, Eigen::all);
    result(fold, Eigen::all) = MatrixXd(of_fold.llt().solve(rows));
  }
  return result.cast<float>();
}

Eigen::VectorXf LightPredictors::constants(int channel, double exponent, const MatrixXf& series) const {
  const Eigen::RowVectorXf sums = inverse(channel, exponent).colwise().sum().cast<float>();
  return (sums * series).transpose();
}

std::vector<MatrixXd> LightPredictors::smooth_grams(int channel, double exponent,
                                                    VectorXd& brightness) const {
  constexpr double smooth = 0.5, detailed = 0.125;  // of the map's width
  const auto& of = lights_.of_channel[channel];
  const double e = exponent - 1.0;
  const MatrixXd lights = blurred(of[0] + e * of[1] + 0.5 * e * e * of[2], lights_.columns, lights_.rows,
                                  0.0)(chosen_, Eigen::all);
  const int columns = std::min(lights_.columns, coarse_columns);
  const auto gram = [&](double width) {
    MatrixXd covariance(lights.cols(), lights.cols());
    for (int j = 0; j < covariance.cols(); ++j)
      for (int i = 0; i < covariance.rows(); ++i) {
        const double distance = std::hypot(i % columns - j % columns, i / columns - j / columns) / columns;
        covariance(i, j) = std::exp(-0.5 * distance * distance / (width * width));
      }
    return MatrixXd(lights * covariance * lights.transpose());
  };
  const MatrixXd of_smooth = gram(smooth), of_detailed = gram(detailed);
  brightness = of_smooth.diagonal().cwiseSqrt().cwiseMax(1e-20);
  const auto normalise = brightness.cwiseInverse().asDiagonal();
  std::vector<MatrixXd> grams;
  for (const double share : {0.0, 0.001, 0.01, 0.1, 1.0})
    grams.emplace_back(normalise * (of_smooth + share * of_detailed) * normalise);
  return grams;
}

void LightPredictors::blur(int first, int last) {
  for (int c = 0; c < 3; ++c)
    for (int k = first; k < last; ++k) {
      const MatrixXd all =
          blurred(lights_.of_channel[c][k], lights_.columns, lights_.rows, all_ways[way_].blur);
      blurred_[c][k] = all(chosen_, Eigen::all);
    }
}

MatrixXd LightPredictors::inverse(int channel, double exponent, bool with_constant) const {
  const auto& of = blurred_[channel];
  const double e = exponent - 1.0;
  const MatrixXd features = e == 0.0 ? of[0] : of[0] + e * of[1] + 0.5 * e * e * of[2];
  MatrixXd gram = features * features.transpose();
  const double mean = gram.trace() / static_cast<double>(gram.rows());
  if (mean > 0.0) gram /= mean;
  if (with_constant) gram.array() += 1.0;
  return ridge_inverse(gram, all_ways[way_].ridge);
}

Eigen::VectorXf inverse_powers(const MatrixXf& residuals) {
  return (residuals.colwise().squaredNorm().transpose().array() + 1e-20f).inverse();
}

double criterion(const MatrixXf& leave_one_out, const MatrixXf& series) {
  const MatrixXf residual = leave_one_out * series;
  double sum = 0.0;
  for (Index p = 0; p < series.cols(); ++p)
    sum += std::log((residual.col(p).squaredNorm() + 1e-20) / (series.col(p).squaredNorm() + 1e-20));
  return sum / static_cast<double>(std::max<Index>(1, series.cols()));
}

double agreement(const std::array<MatrixXf, 3>& before, const std::array<MatrixXf, 3>& after) {
  Eigen::ArrayXd gains = Eigen::ArrayXd::Zero(before[0].rows());
  for (int c = 0; c < 3; ++c) {
    const Eigen::VectorXf weights = inverse_powers(before[c]);
    const MatrixXf old_squares = before[c].cwiseAbs2(), new_squares = after[c].cwiseAbs2();
    const Eigen::VectorXf old_power = old_squares * weights, new_power = new_squares * weights;
    gains += ((old_power.array() + 1e-12f) / (new_power.array() + 1e-12f)).log().cast<double>();
  }
  const auto count = static_cast<double>(gains.size());
  const double mean = gains.mean();
  const double variance = (gains - mean).square().sum() / (count - 1.0);
  return variance > 0.0 ? mean / std::sqrt(variance / count) : 0.0;
}

double relative(double value) {
  return std::exp(0.5 * value);
}

}  // namespace refield
