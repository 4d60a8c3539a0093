// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "core/image/image.h"
#include "simulate/dynamic/brdf_factors.h"

namespace refield::dynamic_chart {

/// Half diffuse, half Phong, as in figure 10 of the paper.
dynamic::Brdf half_glossy(float exponent);

struct FactorRow {
  float exponent;
  int terms;
  double error;  ///< of the BRDF
  double
      area_light_error;  ///< of what it reflects of an area light of angular radius study_area_light_radius
};

inline constexpr double study_area_light_radius = 0.6;

/// Each exponent by 1, 2, 4 … 256 terms. Throws Interrupted.
std::vector<FactorRow> study_factors(const std::vector<float>& exponents);

/// Spheres under such an area light, a column for each exponent; in rows: by 4 terms, by as many as an error
/// of 0.1 takes, and exact. `size`: of one, pixels.
Image factor_picture(const std::vector<float>& exponents, int size);

}  // namespace refield::dynamic_chart
