// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/zonal.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <span>

namespace refield::dynamic {

namespace {

constexpr double whole_sphere = 4.0 * std::numbers::pi;
constexpr int zonal_samples = 513;  // odd: one lies on the horizon
constexpr std::size_t cap_samples = 257;

double legendre(std::size_t band, double cosine) {
  return std::legendre(static_cast<unsigned>(band), cosine);
}

/// Σ_l (2l + 1)/4π c_l P_l, the function of which c_l = ∫ f P_l dω.
double zonal_sum(std::span<const double> bands, double cosine) {
  double sum = 0.0;
  for (std::size_t l = 0; l < bands.size(); ++l)
    sum += (2.0 * static_cast<double>(l) + 1.0) / whole_sphere * bands[l] * legendre(l, cosine);
  return sum;
}

CapEdges::Edge cap_edge(int order, double share) {
  const double cosine = 1.0 - 2.0 * share, angle = std::acos(cosine);
  std::vector<double> bands{whole_sphere * share};
  for (std::size_t l = 1; l < static_cast<std::size_t>(order); ++l)
    bands.push_back(2.0 * std::numbers::pi * (legendre(l - 1, cosine) - legendre(l + 1, cosine)) /
                    (2.0 * static_cast<double>(l) + 1.0));
  constexpr double step = 1e-3;
  const double inside = zonal_sum(bands, std::cos(angle - step)),
               outside = zonal_sum(bands, std::cos(angle + step));
  return {static_cast<float>(zonal_sum(bands, cosine)),
          static_cast<float>(std::max((inside - outside) / (2.0 * step), 0.0))};
}

}  // namespace

float ZonalTable::operator()(float cosine) const {
  const float last = static_cast<float>(samples_.size() - 1);
  const float place = std::clamp(0.5f * (cosine + 1.0f) * last, 0.0f, last);
  const auto i = std::min(static_cast<std::size_t>(place), samples_.size() - 2);
  return samples_[i] + (place - static_cast<float>(i)) * (samples_[i + 1] - samples_[i]);
}

CapEdges::CapEdges(int order) {
  for (std::size_t i = 0; i < cap_samples; ++i) {
    const double root = static_cast<double>(i) / (cap_samples - 1);
    edges_.push_back(cap_edge(order, root * root));
  }
}

CapEdges::Edge CapEdges::at(float share) const {
  const float place = std::sqrt(std::clamp(share, 0.0f, 1.0f)) * static_cast<float>(cap_samples - 1);
  const auto i = std::min(static_cast<std::size_t>(place), cap_samples - 2);
  const float after = place - static_cast<float>(i), before = 1.0f - after;
  return {before * edges_[i].value + after * edges_[i + 1].value,
          before * edges_[i].slope + after * edges_[i + 1].slope};
}

FirstTerm first_term(const BrdfFactors& factors, int order) {
  std::vector<float> exact(zonal_samples, 0.0f), by_harmonics, h(static_cast<std::size_t>(factors.terms()));
  std::vector<double> bands(static_cast<std::size_t>(order), 0.0);
  const auto cosine_of = [](int i) { return 2.0 * i / (zonal_samples - 1) - 1.0; };
  for (int i = zonal_samples / 2 + 1; i < zonal_samples && !h.empty(); ++i) {
    const double z = cosine_of(i);
    factors.incoming({static_cast<float>(std::sqrt(1.0 - z * z)), 0.0f, static_cast<float>(z)}, h);
    exact[static_cast<std::size_t>(i)] = h[0] * static_cast<float>(z);
    const double weight = whole_sphere / (zonal_samples - 1) * (i + 1 == zonal_samples ? 0.5 : 1.0);
    for (std::size_t l = 0; l < bands.size(); ++l) bands[l] += weight * h[0] * z * legendre(l, z);
  }
  FirstTerm first;
  first.sign = bands[0] < 0.0 ? -1.0f : 1.0f;
  for (int i = 0; i < zonal_samples; ++i)
    by_harmonics.push_back(first.sign * static_cast<float>(zonal_sum(bands, cosine_of(i))));
  for (float& value : exact) value *= first.sign;
  constexpr float small = 0.02f;
  first.least = small * std::ranges::max(by_harmonics);
  first.exact = ZonalTable(std::move(exact));
  first.by_harmonics = ZonalTable(std::move(by_harmonics));
  return first;
}

}  // namespace refield::dynamic
