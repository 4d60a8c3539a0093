// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <algorithm>
#include <cmath>
#include <limits>

namespace refield {

/// Bayesian information criterion of a fit with unknown noise (Schwarz 1978): N log(residual / N) +
/// parameters · log N. The residual is taken as no smaller than float32 columns can tell.
inline double information_criterion(double squared_residual, double squared_samples, double measured,
                                    int parameters) {
  constexpr double exact_fit = 1e-10;
  const double floor = std::max(exact_fit * squared_samples, std::numeric_limits<double>::min());
  return measured * std::log(std::max(squared_residual, floor) / measured) + parameters * std::log(measured);
}

}  // namespace refield
