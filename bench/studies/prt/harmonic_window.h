// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cmath>
#include <numbers>
#include <vector>

namespace refield {

/// How the bands l of a function cut off at an order n are damped, so that what is small and bright does not
/// ring around itself; what is smooth loses contrast. hann: (1 + cos(πl/n))/2. lanczos: sin(πl/n)/(πl/n).
enum class HarmonicWindow { none, hann, lanczos };

/// The factor of each harmonic, [order²].
inline std::vector<double> window_factors(HarmonicWindow window, int order) {
  std::vector<double> factors;
  for (int band = 0; band < order; ++band) {
    const double angle = std::numbers::pi * band / order;
    double factor = 1.0;
    if (window == HarmonicWindow::hann) factor = 0.5 * (1.0 + std::cos(angle));
    if (window == HarmonicWindow::lanczos && band > 0) factor = std::sin(angle) / angle;
    factors.insert(factors.end(), 2 * band + 1, factor);
  }
  return factors;
}

}  // namespace refield
