// SPDX-License-Identifier: Apache-2.0
#include "acquire/calibrate/monotone_curve.h"

#include <algorithm>
#include <cmath>

#include "core/base/errors.h"

namespace refield {

std::vector<double> never_falling(std::vector<double> values, std::vector<double> weights) {
  if (weights.empty()) weights.assign(values.size(), 1.0);
  struct Pool {
    double value;
    double weight;
    std::size_t size;
  };
  std::vector<Pool> pools;
  for (std::size_t i = 0; i < values.size(); ++i) {
    pools.push_back({values[i], weights[i], 1});
    while (pools.size() > 1 && pools[pools.size() - 2].value > pools.back().value) {
      const Pool last = pools.back();
      pools.pop_back();
      Pool& into = pools.back();
      into.value = (into.value * into.weight + last.value * last.weight) / (into.weight + last.weight);
      into.weight += last.weight;
      into.size += last.size;
    }
  }
  std::size_t i = 0;
  for (const Pool& pool : pools)
    for (std::size_t k = 0; k < pool.size; ++k) values[i++] = pool.value;
  return values;
}

MonotoneCurve::MonotoneCurve(std::vector<double> x, std::vector<double> y)
    : x_(std::move(x)), y_(std::move(y)), slope_(x_.size(), 0.0) {
  const std::size_t n = x_.size();
  if (n < 2 || y_.size() != n || !std::ranges::is_sorted(x_, std::less_equal<>()))
    throw InputError("a curve needs at least two points in growing order");
  std::vector<double> step(n - 1), secant(n - 1);
  for (std::size_t i = 0; i + 1 < n; ++i) {
    step[i] = x_[i + 1] - x_[i];
    secant[i] = (y_[i + 1] - y_[i]) / step[i];
  }
  for (std::size_t i = 1; i + 1 < n; ++i) {
    if (secant[i - 1] * secant[i] <= 0.0) continue;
    const double before = 2.0 * step[i] + step[i - 1];
    const double after = step[i] + 2.0 * step[i - 1];
    slope_[i] = (before + after) / (before / secant[i - 1] + after / secant[i]);
  }
  // At the ends as a parabola would have it, but not so steep that the curve overshoots.
  const auto end_slope = [](double s0, double s1, double h0, double h1) {
    const double slope = ((2.0 * h0 + h1) * s0 - h0 * s1) / (h0 + h1);
    if (slope * s0 <= 0.0) return 0.0;
    return std::abs(slope) > 3.0 * std::abs(s0) ? 3.0 * s0 : slope;
  };
  if (n == 2) {
    slope_.assign(2, secant[0]);
  } else {
    slope_[0] = end_slope(secant[0], secant[1], step[0], step[1]);
    slope_[n - 1] = end_slope(secant[n - 2], secant[n - 3], step[n - 2], step[n - 3]);
  }
}

std::size_t MonotoneCurve::interval(double x) const {
  const auto above = std::ranges::upper_bound(x_, x) - x_.begin();
  return static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(above - 1, 0, std::ssize(x_) - 2));
}

double MonotoneCurve::operator()(double x) const {
  if (x <= x_.front()) return y_.front() + slope_.front() * (x - x_.front());
  if (x >= x_.back()) return y_.back() + slope_.back() * (x - x_.back());
  const std::size_t i = interval(x);
  const double h = x_[i + 1] - x_[i];
  const double t = (x - x_[i]) / h;
  const double u = 1.0 - t;
  return y_[i] * u * u * (1.0 + 2.0 * t) + y_[i + 1] * t * t * (3.0 - 2.0 * t) +
         h * t * u * (slope_[i] * u - slope_[i + 1] * t);
}

double MonotoneCurve::slope(double x) const {
  if (x <= x_.front()) return slope_.front();
  if (x >= x_.back()) return slope_.back();
  const std::size_t i = interval(x);
  const double h = x_[i + 1] - x_[i];
  const double t = (x - x_[i]) / h;
  return 6.0 * t * (1.0 - t) * (y_[i + 1] - y_[i]) / h + slope_[i] * (1.0 - t) * (1.0 - 3.0 * t) +
         slope_[i + 1] * t * (3.0 * t - 2.0);
}

}  // namespace refield
