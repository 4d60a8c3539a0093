// SPDX-License-Identifier: Apache-2.0
#include "core/base/rng.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace refield {

double Rng::normal() {
  const double radius = std::sqrt(-2.0 * std::log1p(-uniform()));
  return radius * std::cos(2.0 * std::numbers::pi * uniform());
}

double Rng::poisson(double mean) {
  if (mean >= 64.0) return std::max(0.0, std::round(mean + std::sqrt(mean) * normal()));
  // Knuth's product of uniforms.
  const double limit = std::exp(-mean);
  double product = uniform();
  double count = 0.0;
  while (product > limit) {
    product *= uniform();
    ++count;
  }
  return count;
}

}  // namespace refield
