// SPDX-License-Identifier: Apache-2.0
#include <Eigen/Dense>

#include <algorithm>
#include <cmath>

#include "acquire/calibrate/monotone_curve.h"
#include "acquire/calibrate/response.h"
#include "core/errors.h"

namespace refield {

namespace {

constexpr int knots = 49;
constexpr double smoothness = 60.0;   // times the data's weight at a knot: smooths over two or three knots
constexpr double model_error = 3e-4;  // of the range: exposures are not exact, either
constexpr int reweightings = 3;

struct Place {
  int knot;
  double above;  // share of the next knot
};

Place place_of(double dn, const std::vector<double>& knot_dn) {
  const double x = (dn - knot_dn.front()) / (knot_dn.back() - knot_dn.front()) * (knots - 1);
  const int knot = std::clamp(static_cast<int>(std::floor(x)), 0, knots - 2);
  return {knot, x - knot};
}

/// Unknowns: g at the knots, then the light of each source for the longest exposure.
class ResponseSystem {
 public:
  ResponseSystem(const std::vector<ResponseDatum>& data, const std::vector<double>& knot_dn)
      : data_(data), knot_dn_(knot_dn) {
    for (const ResponseDatum& datum : data) {
      sources_ = std::max(sources_, datum.source + 1);
      longest_ = std::max(longest_, datum.exposure_s);
    }
  }

  void solve(const std::vector<double>& weights) {
    const int size = knots + sources_;
    normal_ = Eigen::MatrixXd::Zero(size, size);
    for (std::size_t i = 0; i < data_.size(); ++i) {
      const auto [knot, above] = place_of(data_[i].dn, knot_dn_);
      add({{knot, 1.0 - above},
           {knot + 1, above},
           {knots + data_[i].source, -data_[i].exposure_s / longest_}},
          weights[i]);
    }
    const Eigen::VectorXd weight = normal_.diagonal().head(knots);
    constexpr double least = 1e-6;  // where there are no data, any pull will do
    for (int k = 1; k + 1 < knots; ++k)
      if (weight(k) < least * weight.maxCoeff())  // beyond the data a straight line is safer than a parabola
        add({{k - 1, 1.0}, {k, -2.0}, {k + 1, 1.0}}, smoothness * least * weight.maxCoeff());
    for (int k = 1; k + 2 < knots; ++k)
      add({{k - 1, -1.0}, {k, 3.0}, {k + 1, -3.0}, {k + 2, 1.0}},
          smoothness * std::max(weight(k), least * weight.maxCoeff()));
    // The equations hold for any scale of light. Fixing it at one knot would let all others shrink a little,
    // for small light has small errors; so the mean over the data is fixed instead. g(black) = 0 is known.
    Eigen::VectorXd mean = Eigen::VectorXd::Zero(size);
    for (const ResponseDatum& datum : data_) {
      const auto [knot, above] = place_of(datum.dn, knot_dn_);
      mean(knot) += 1.0 - above;
      mean(knot + 1) += above;
    }
    const Eigen::VectorXd solution =
        normal_.bottomRightCorner(size - 1, size - 1).ldlt().solve(mean.tail(size - 1));
    const double top = solution(knots - 2);
    light_.assign(size, 0.0);
    for (int k = 1; k < size; ++k) light_[k] = solution(k - 1) / top;
  }

  double predicted(std::size_t i) const {
    return light_[knots + data_[i].source] * data_[i].exposure_s / longest_;
  }
  double measured(std::size_t i) const {
    const auto [knot, above] = place_of(data_[i].dn, knot_dn_);
    return light_[knot] * (1.0 - above) + light_[knot + 1] * above;
  }
  double slope(std::size_t i) const {
    const int knot = place_of(data_[i].dn, knot_dn_).knot;
    return (light_[knot + 1] - light_[knot]) / (knot_dn_[1] - knot_dn_[0]);
  }
  std::vector<double> curve() const { return {light_.begin(), light_.begin() + knots}; }

 private:
  void add(std::initializer_list<std::pair<int, double>> row, double weight) {
    for (const auto& [a, factor_a] : row)
      for (const auto& [b, factor_b] : row) normal_(a, b) += weight * factor_a * factor_b;
  }

  const std::vector<ResponseDatum>& data_;
  const std::vector<double>& knot_dn_;
  int sources_ = 0;
  double longest_ = 0.0;
  Eigen::MatrixXd normal_;
  std::vector<double> light_;
};

}  // namespace

ResponseFit fit_response(const std::vector<ResponseDatum>& data, double black_dn, double saturation_dn) {
  double highest = black_dn;
  for (const ResponseDatum& datum : data) highest = std::max(highest, datum.dn);
  constexpr std::size_t fewest = 4 * knots;
  if (data.size() < fewest || highest - black_dn < 0.5 * (saturation_dn - black_dn))
    throw InputError("the camera's response cannot be fitted: " + std::to_string(data.size()) +
                     " samples reach from black at " + std::to_string(black_dn) + " DN to " +
                     std::to_string(highest) + " DN, of a range to " + std::to_string(saturation_dn) +
                     " DN; give it more light or a wider range of exposures");
  ResponseFit fit;
  for (int k = 0; k < knots; ++k) fit.dn.push_back(black_dn + (saturation_dn - black_dn) * k / (knots - 1.0));
  ResponseSystem system(data, fit.dn);
  std::vector<double> weights(data.size(), 1.0);
  for (int round = 0; round <= reweightings; ++round) {
    system.solve(weights);
    for (std::size_t i = 0; i < data.size(); ++i)
      weights[i] = 1.0 / (data[i].variance * system.slope(i) * system.slope(i) + model_error * model_error);
  }
  double squares = 0.0;
  for (std::size_t i = 0; i < data.size(); ++i)
    squares += std::pow(system.measured(i) - system.predicted(i), 2) / static_cast<double>(data.size());
  fit.residual = std::sqrt(squares);
  fit.light = never_falling(system.curve());
  return fit;
}

}  // namespace refield
