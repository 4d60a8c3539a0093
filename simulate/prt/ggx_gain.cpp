// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/ggx_gain.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace refield::prt {

namespace {

constexpr int samples = 4096;

/// Calls use(u, v) for points of the unit square (Roberts 2018).
template <class Use>
void for_samples(const Use& use) {
  constexpr double g = 1.32471795724474602596;
  for (int i = 0; i < samples; ++i) use(std::fmod((i + 0.5) / g, 1.0), std::fmod((i + 0.5) / (g * g), 1.0));
}

/// Reflectance of uniform light at f₀ = 1 less its Fresnel part, and that part, by half vectors of GGX's
/// distribution.
GgxGain::At reflected_by_ggx(double alpha, double cosine) {
  const double sine = std::sqrt(1.0 - cosine * cosine), squared = alpha * alpha;
  const auto shadow = [&](double c) { return std::sqrt(squared + (1.0 - squared) * c * c); };
  double scale = 0.0, offset = 0.0;
  for_samples([&](double u, double v) {
    const double half = std::sqrt((1.0 - u) / (1.0 + (squared - 1.0) * u));
    const double across = std::sqrt(1.0 - half * half) * std::cos(2.0 * std::numbers::pi * v);
    const double sight = sine * across + cosine * half;
    const double light = 2.0 * sight * half - cosine;
    if (sight <= 0.0 || light <= 0.0) return;
    const double smith = 2.0 * light * cosine / (cosine * shadow(light) + light * shadow(cosine));
    const double weight = smith * sight / (half * cosine), fresnel = std::pow(1.0 - sight, 5.0);
    scale += weight * (1.0 - fresnel);
    offset += weight * fresnel;
  });
  return {static_cast<float>(scale / samples), static_cast<float>(offset / samples)};
}

/// The same of a Phong lobe of reflectance 1, by directions of its density.
double reflected_by_phong(double exponent, double cosine) {
  const double sine = std::sqrt(1.0 - cosine * cosine);
  double sum = 0.0;
  for_samples([&](double u, double v) {
    const double along = std::pow(1.0 - u, 1.0 / (exponent + 1.0));
    const double across =
        std::sqrt(std::max(0.0, 1.0 - along * along)) * std::cos(2.0 * std::numbers::pi * v);
    sum += std::max(0.0, along * cosine + across * sine);
  });
  return sum / samples * (exponent + 2.0) / (exponent + 1.0);
}

}  // namespace

float phong_exponent(float roughness) {
  const float alpha = roughness * roughness;
  return 0.375f * (1.0f / (alpha * alpha) - 1.0f);
}

GgxGain::GgxGain(float roughness) {
  const double alpha = static_cast<double>(roughness) * roughness, exponent = phong_exponent(roughness);
  for (std::size_t i = 0; i < places; ++i) {
    const double cosine = (static_cast<double>(i) + 0.5) / places;
    const At ggx = reflected_by_ggx(alpha, cosine);
    const auto phong = static_cast<float>(reflected_by_phong(exponent, cosine));
    table_[i] = {ggx.scale / phong, ggx.offset / phong};
  }
}

GgxGain::At GgxGain::operator()(float cosine) const {
  const float place = std::clamp(std::abs(cosine) * places - 0.5f, 0.0f, places - 1.0f);
  const auto i = std::min(static_cast<std::size_t>(place), places - 2);
  const float share = place - static_cast<float>(i);
  const auto between = [&](float At::*of) {
    return (1.0f - share) * table_[i].*of + share * table_[i + 1].*of;
  };
  return {between(&At::scale), between(&At::offset)};
}

}  // namespace refield::prt
