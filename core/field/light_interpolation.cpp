// SPDX-License-Identifier: Apache-2.0
#include "core/field/light_interpolation.h"

#include <tbb/parallel_for.h>

#include <array>
#include <utility>

#include "core/base/units.h"
#include "core/field/light_covariance.h"
#include "core/image/metrics.h"

namespace refield {

using namespace gaussian_process;

namespace {

constexpr std::size_t min_sources = 8;  // fewer tell nothing of the lengths
constexpr std::size_t max_sources = 1024;
constexpr double max_source_degrees = 10.0;

/// Tried, each with each. On real photographs under 64 to 240 light sources the choice is inside the grid
/// (docs/method/light-stages.md).
constexpr std::array tried_lengths = {0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4};
constexpr std::array tried_shares = {1e-4, 1e-3, 3e-3, 1e-2, 3e-2, 1e-1, 3e-1};
/// Multiples of the median distance between neighbouring sources. A shorter fine part changes the error of
/// left-out sources by less than 2 %; a longer one increases it. At up to three distances outside the
/// sources, extrapolation is better than darkness on all sets.
constexpr double fine_spacing = 0.25, reach_spacing = 3.0;

double solid_angle_of(const Box& box, const LightDomain& domain) {
  double sum = 0.0;
  for (int y = box.y0; y < box.y1; ++y)
    sum += box.width() * lat_long_solid_angle(y, domain.width, domain.height);
  return sum;
}

/// Median distance of a source to the nearest other one.
double median_spacing(Eigen::ArrayXXd chords) {
  chords.matrix().diagonal().setConstant(2.0);
  std::vector<double> nearest(static_cast<std::size_t>(chords.cols()));
  for (Eigen::Index i = 0; i < chords.cols(); ++i)
    nearest[static_cast<std::size_t>(i)] = chords.col(i).minCoeff();
  return upper_median(std::move(nearest));
}

/// Relative RMSE of a pixel over the sources, each predicted from all others (Rasmussen and Williams 2006,
/// eq. 5.12): its mean logarithm over the pixels of `responses` [sources × 3 pixels], whose squared sum is 1
/// each. The mean itself would follow the few pixels at edges of shadows, which no choice predicts.
double left_out_error(const LightInterpolation& interpolation, const Eigen::ArrayXXd& chords,
                      const Eigen::MatrixXd& responses) {
  const Eigen::Index count = chords.rows();
  const Eigen::MatrixXd inverse =
      factorised(interpolation, chords).solve(Eigen::MatrixXd::Identity(count, count));
  const Eigen::MatrixXd residuals = inverse.diagonal().cwiseInverse().asDiagonal() * (inverse * responses);
  const Eigen::RowVectorXd squared = residuals.colwise().squaredNorm();
  constexpr double negligible = 1e-12;
  return 0.5 * squared.reshaped(3, squared.size() / 3).colwise().sum().array().max(negligible).log().mean();
}

}  // namespace

std::string LightInterpolation::fault(const LightDomain& domain) const {
  const auto is_positive = [](double value) { return value > 0.0 && std::isfinite(value); };
  if (domain.parameterisation != Parameterisation::lat_long) return "belongs to lat-long light maps only";
  if (sources.empty() || sources.size() > max_sources)
    return "needs 1 to " + std::to_string(max_sources) + " light sources";
  if (!is_positive(length) || !is_positive(fine_length) || !is_positive(reach) || !(fine_share >= 0.0) ||
      !(fine_share <= 1.0))
    return "has an impossible length or share";
  const auto inside = [&](const Box& box) { return box.inside(domain.width, domain.height); };
  return std::ranges::all_of(sources, inside) ? "" : "has a light source outside the light map";
}

LightInterpolator::LightInterpolator(const LightInterpolation& interpolation, const LightDomain& domain)
    : interpolation_(interpolation), domain_(domain) {
  if (const std::string fault = interpolation.fault(domain); !fault.empty())
    throw InputError("the interpolation between light sources ", fault);
  directions_ = directions_of(interpolation.sources, domain);
  solid_angles_.resize(directions_.rows());
  for (int y = 0; y < domain.height; ++y)
    row_angles_.push_back(lat_long_solid_angle(y, domain.width, domain.height));
  is_source_.resize(static_cast<std::size_t>(domain.width) * static_cast<std::size_t>(domain.height), 0);
  for (std::size_t i = 0; i < interpolation.sources.size(); ++i) {
    const Box& box = interpolation.sources[i];
    solid_angles_[static_cast<Eigen::Index>(i)] = solid_angle_of(box, domain);
    for (int y = box.y0; y < box.y1; ++y)
      std::fill_n(is_source_.begin() + static_cast<std::ptrdiff_t>(y) * domain.width + box.x0, box.width(),
                  1);
  }
  factor_ = factorised(interpolation, chords_of((directions_ * directions_.transpose()).array()));
}

double LightInterpolator::nearness(const Eigen::VectorXd& cosines) const {
  return nearness_of(interpolation_, cosines);
}

template <class Visit>
void LightInterpolator::for_dark_texels(const Image& radiance, int row, Visit&& visit) const {
  const std::span<const float> values = radiance.row(row);
  for (int x = 0; x < domain_.width; ++x) {
    const float* texel = values.data() + std::ptrdiff_t{3} * x;
    if (is_source_[static_cast<std::size_t>(row) * domain_.width + x] != 0 ||
        (texel[0] == 0.0f && texel[1] == 0.0f && texel[2] == 0.0f))
      continue;
    const Eigen::VectorXd cosines =
        directions_ * lat_long_direction(x + 0.5, row + 0.5, domain_.width, domain_.height);
    const Eigen::RowVector3d irradiance =
        row_angles_[static_cast<std::size_t>(row)] * Eigen::RowVector3d(texel[0], texel[1], texel[2]);
    visit(irradiance, cosines, nearness(cosines));
  }
}

void LightInterpolator::gather(Image& radiance) const {
  require_domain({radiance, Parameterisation::lat_long}, domain_);
  const Eigen::Index count = directions_.rows();
  std::vector<Eigen::MatrixXd> of_rows(static_cast<std::size_t>(domain_.height));
  tbb::parallel_for(0, domain_.height, [&](int row) {
    Eigen::MatrixXd& sums = of_rows[static_cast<std::size_t>(row)];
    for_dark_texels(
        radiance, row,
        [&](const Eigen::RowVector3d& irradiance, const Eigen::VectorXd& cosines, double nearness) {
          if (nearness <= 0.0) return;
          if (sums.size() == 0) sums = Eigen::MatrixXd::Zero(count, 3);
          sums += nearness * covariance(interpolation_, chords_of(cosines.array())).matrix() * irradiance;
        });
  });
  // In the order of rows, so that results do not depend on the number of threads.
  Eigen::MatrixXd irradiance = Eigen::MatrixXd::Zero(count, 3);
  for (const Eigen::MatrixXd& sums : of_rows)
    if (sums.size() != 0) irradiance += sums;
  irradiance = factor_.solve(irradiance);
  for (std::size_t t = 0; t < is_source_.size(); ++t)
    if (is_source_[t] == 0) std::fill_n(&radiance.values[3 * t], 3, 0.0f);
  for (Eigen::Index i = 0; i < count; ++i) {
    const Box& box = interpolation_.sources[static_cast<std::size_t>(i)];
    for (int y = box.y0; y < box.y1; ++y)
      for (int x = box.x0; x < box.x1; ++x)
        for (int c = 0; c < 3; ++c)
          radiance.at(x, y, c) += static_cast<float>(irradiance(i, c) / solid_angles_[i]);
  }
}

LightShares LightInterpolator::shares(const Image& radiance) const {
  double all = 0.0;
  LightShares shares;
  for (int row = 0; row < domain_.height; ++row) {
    double sum = 0.0;
    for (const float value : radiance.row(row)) sum += value;
    all += sum * row_angles_[static_cast<std::size_t>(row)];
    for_dark_texels(radiance, row,
                    [&](const Eigen::RowVector3d& irradiance, const Eigen::VectorXd&, double nearness) {
                      shares.interpolated += nearness * irradiance.sum();
                      shares.unobserved += (1.0 - nearness) * irradiance.sum();
                    });
  }
  if (!(all > 0.0)) return {};
  return {std::clamp(shares.interpolated / all, 0.0, 1.0), std::clamp(shares.unobserved / all, 0.0, 1.0)};
}

bool can_interpolate(const std::vector<Box>& sources, const LightDomain& domain) {
  if (domain.parameterisation != Parameterisation::lat_long || sources.size() < min_sources ||
      sources.size() > max_sources)
    return false;
  std::int64_t lit = 0;
  for (const Box& box : sources) {
    lit += box.area();
    const Eigen::Vector3d corner = lat_long_direction(box.x0, box.y0, domain.width, domain.height);
    const Eigen::Vector3d opposite = lat_long_direction(box.x1, box.y1, domain.width, domain.height);
    if (box.area() > 1 && (corner - opposite).norm() > radians_from_degrees(max_source_degrees)) return false;
  }
  return lit < std::int64_t{domain.width} * domain.height;
}

std::optional<LightInterpolation> fit_light_interpolation(const std::vector<Box>& sources,
                                                          const LightDomain& domain,
                                                          const Eigen::MatrixXd& responses) {
  if (!can_interpolate(sources, domain)) return std::nullopt;
  const Eigen::MatrixXd directions = directions_of(sources, domain);
  const Eigen::ArrayXXd chords = chords_of((directions * directions.transpose()).array());
  const double spacing = median_spacing(chords);
  const Eigen::RowVectorXd of_columns = responses.colwise().squaredNorm();
  const Eigen::RowVectorXd energies = of_columns.reshaped(3, of_columns.size() / 3).colwise().sum();
  const double brightest = energies.size() == 0 ? 0.0 : energies.maxCoeff();
  if (!(brightest > 0.0) || !std::isfinite(brightest) || !(spacing > 0.0)) return std::nullopt;
  // Pixels count alike, dark ones too, but not those that are next to nothing.
  Eigen::MatrixXd normalised(responses.rows(), responses.cols());
  Eigen::Index columns = 0;
  for (Eigen::Index p = 0; p < energies.size(); ++p) {
    if (!(energies[p] > 1e-8 * brightest)) continue;
    normalised.middleCols(columns, 3) = responses.middleCols(3 * p, 3) / std::sqrt(energies[p]);
    columns += 3;
  }
  normalised.conservativeResize(Eigen::NoChange, columns);
  std::vector<LightInterpolation> candidates;
  for (const double length : tried_lengths)
    for (const double share : tried_shares)
      candidates.push_back({sources, length, share, fine_spacing * spacing, reach_spacing * spacing});
  std::vector<double> errors(candidates.size());
  tbb::parallel_for(std::size_t{0}, candidates.size(),
                    [&](std::size_t i) { errors[i] = left_out_error(candidates[i], chords, normalised); });
  const auto best = std::ranges::min_element(errors) - errors.begin();
  return std::move(candidates[static_cast<std::size_t>(best)]);
}

}  // namespace refield
