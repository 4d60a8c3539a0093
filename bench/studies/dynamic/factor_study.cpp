// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/dynamic/factor_study.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "bench/studies/dynamic/area_light_error.h"
#include "bench/studies/dynamic/picture_grid.h"
#include "cli/run_context.h"
#include "simulate/dynamic/brdf.h"

namespace refield::dynamic_chart {

using dynamic::Brdf;
using dynamic::BrdfFactors;

namespace {

using Reflection = std::function<Eigen::Array3f(const Eigen::Vector3f& in, const Eigen::Vector3f& out)>;

/// A sphere seen along +Z from far away, lit from above the viewer's left.
Image sphere(const Reflection& reflection, int size) {
  const auto area_light = dynamic::disc_of_directions(Eigen::Vector3f(-0.5f, 0.6f, -0.62f).normalized(),
                                                      study_area_light_radius, 150);
  Image image(size, size, 3);
  tbb::parallel_for(0, size, [&](int y) {
    for (int x = 0; x < size; ++x) {
      const Eigen::Vector2f at(2.2f * (static_cast<float>(x) + 0.5f) / static_cast<float>(size) - 1.1f,
                               1.1f - 2.2f * (static_cast<float>(y) + 0.5f) / static_cast<float>(size));
      if (at.norm() >= 1.0f) continue;
      const Eigen::Matrix3f frame =
          dynamic::tangent_frame({at.x(), at.y(), -std::sqrt(1.0f - at.squaredNorm())});
      const Eigen::Vector3f out = frame * -Eigen::Vector3f::UnitZ();
      Eigen::Array3f sum = Eigen::Array3f::Zero();
      for (const Eigen::Vector3f& direction : area_light) {
        const Eigen::Vector3f in = frame * direction;
        if (in.z() > 0.0f) sum += in.z() * reflection(in, out);
      }
      for (int c = 0; c < 3; ++c)
        image.at(x, y, c) = std::max(0.0f, 1.6f * sum[c] / static_cast<float>(area_light.size()));
    }
  });
  return image;
}

}  // namespace

Brdf half_glossy(float exponent) {
  return {.diffuse = {0.5f, 0.5f, 0.5f},
          .specular = {0.5f, 0.5f, 0.5f},
          .lobe = dynamic::Lobe::phong,
          .exponent = exponent};
}

std::vector<FactorRow> study_factors(const std::vector<float>& exponents) {
  std::vector<FactorRow> rows;
  Progress progress(run_context(), "BRDFs in terms", exponents.size());
  for (const float exponent : exponents) {
    const Brdf brdf = half_glossy(exponent);
    for (int terms = 1; terms <= dynamic::FactorOptions::max_terms; terms *= 2) {
      run_context().throw_if_stopped();
      const BrdfFactors factors = factor(brdf, {.largest = terms, .error = 1e-3}, run_context());
      rows.push_back({exponent, factors.terms(), factors.error(),
                      area_light_error(brdf, factors, study_area_light_radius)});
      if (factors.terms() + 1 < terms) break;  // more are not needed
    }
    progress.advance();
  }
  return rows;
}

Image factor_picture(const std::vector<float>& exponents, int size) {
  std::vector<Image> pictures(3 * exponents.size());
  for (std::size_t e = 0; e < exponents.size(); ++e) {
    const Brdf brdf = half_glossy(exponents[e]);
    pictures[e] = sphere(factor(brdf, {.largest = 4, .error = 0.0}, run_context()), size);
    pictures[exponents.size() + e] = sphere(factor(brdf, {.error = 0.1}, run_context()), size);
    pictures[2 * exponents.size() + e] = sphere(brdf, size);
  }
  return picture_grid(pictures, static_cast<int>(exponents.size()));
}

}  // namespace refield::dynamic_chart
