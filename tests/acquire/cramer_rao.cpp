// SPDX-License-Identifier: Apache-2.0
#include "tests/acquire/cramer_rao.h"

#include <cmath>
#include <numbers>

namespace refield::test {

namespace {

double normal_above(double z) {
  return 0.5 * std::erfc(z / std::numbers::sqrt2);
}

/// Probability of raw sample `dn`, the camera being linear.
double probability(int dn, double mean, const CameraCalibration& camera) {
  const double spread = std::sqrt(mean + camera.read_noise_electrons * camera.read_noise_electrons);
  const auto above = [&](double edge_dn) {
    return normal_above(((edge_dn - camera.black_level_dn) * camera.electrons_per_dn - mean) / spread);
  };
  const double from = dn == 0 ? 1.0 : above(dn - 0.5);
  const double to = dn >= static_cast<int>(camera.saturation_dn) ? 0.0 : above(dn + 0.5);
  return from - to;
}

}  // namespace

double information_of_electrons(double mean, const CameraCalibration& camera) {
  const double step = 1e-4 * std::sqrt(mean);
  double information = 0.0;
  for (int dn = 0; dn <= static_cast<int>(camera.saturation_dn); ++dn) {
    const double p = probability(dn, mean, camera);
    if (p < 1e-14) continue;  // beyond seven standard deviations
    const double slope =
        (probability(dn, mean + step, camera) - probability(dn, mean - step, camera)) / (2.0 * step);
    information += slope * slope / p;
  }
  return information;
}

double cramer_rao_bound(double radiance, std::span<const double> exposures, const CameraCalibration& camera) {
  double information = 0.0;
  for (double seconds : exposures) {
    const double electrons = seconds * camera.electrons_per_radiance_second;
    information += electrons * electrons * information_of_electrons(radiance * electrons, camera);
  }
  return 1.0 / std::sqrt(information);
}

}  // namespace refield::test
