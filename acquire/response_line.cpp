// SPDX-License-Identifier: Apache-2.0
#include "acquire/response_line.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace refield {

namespace {

constexpr float unbounded = std::numeric_limits<float>::infinity();
constexpr float useful_share = 0.4f;  // of what an exposure would hold were all equal
constexpr float within_the_noise =
    5.0f;  // standard deviations; beyond, clipping was certain and tells nothing
constexpr int newton_steps = 4;

/// φ(z) / (1 − Φ(z)): the mean of what a normal variable exceeds z by, plus z.
double hazard(double z) {
  constexpr double tail = 8.0;  // from here on the asymptote is exact to 1e-3
  if (z > tail) return z + 1.0 / z;
  const double density = std::exp(-0.5 * z * z) / std::sqrt(2.0 * std::numbers::pi);
  return density / (0.5 * std::erfc(z / std::numbers::sqrt2));
}

}  // namespace

ResponseLines::ResponseLines(std::size_t exposures, std::size_t size)
    : exposures_(exposures),
      size_(size),
      electrons_(exposures * size),
      floor_(exposures * size),
      predicted_(size),
      numerator_(size),
      information_(size) {}

void ResponseLines::fit(std::span<const float> per_radiance, std::span<const ClipLevel> clip,
                        std::span<float> radiance, std::span<float> sigma, std::span<std::uint32_t> useful,
                        std::uint32_t& clipped) {
  predict(per_radiance);
  std::ranges::fill(numerator_, 0.0f);
  std::ranges::fill(information_, 0.0f);
  for (std::size_t i = 0; i < exposures_; ++i) {
    const float* e = electrons(i);
    const float* f = floor(i);
    const float t = per_radiance[i];
    for (std::size_t x = 0; x < size_; ++x) {
      const float weighted_t = t / (predicted_[x] * t + f[x]);
      numerator_[x] += weighted_t * e[x];
      information_[x] += weighted_t * t;
    }
  }
  const std::size_t shortest = std::ranges::min_element(per_radiance) - per_radiance.begin();
  const float* bound = electrons(shortest);
  clipped = 0;
  for (std::size_t x = 0; x < size_; ++x) {
    const bool measured = information_[x] > 0.0f;
    radiance[x] = measured ? numerator_[x] / information_[x] : bound[x] / per_radiance[shortest];
    sigma[x] = measured ? 1.0f / std::sqrt(information_[x]) : unbounded;
    clipped += !measured;
  }
  for (std::size_t i = 0; i < exposures_; ++i) useful[i] = count_useful(i, per_radiance[i]);
  refine_where_clipping_tells(per_radiance, clip, radiance, sigma);
}

/// Radiance Σ electrons / Σ exposure, not below zero: what variances are predicted from.
void ResponseLines::predict(std::span<const float> per_radiance) {
  std::ranges::fill(numerator_, 0.0f);
  std::ranges::fill(information_, 0.0f);
  for (std::size_t i = 0; i < exposures_; ++i) {
    const float* e = electrons(i);
    const float* f = floor(i);
    const float t = per_radiance[i];
    for (std::size_t x = 0; x < size_; ++x) {
      const float usable = f[x] < unbounded ? 1.0f : 0.0f;
      numerator_[x] += usable * e[x];
      information_[x] += usable * t;
    }
  }
  for (std::size_t x = 0; x < size_; ++x)
    predicted_[x] = information_[x] > 0.0f ? std::max(numerator_[x] / information_[x], 0.0f) : 0.0f;
}

void ResponseLines::refine_where_clipping_tells(std::span<const float> per_radiance,
                                                std::span<const ClipLevel> clip, std::span<float> radiance,
                                                std::span<float> sigma) {
  for (std::size_t i = 0; i < exposures_; ++i) {
    const float* f = floor(i);
    const float t = per_radiance[i];
    // The radiance here comes from the other exposures: its own noise widens the doubtful zone.
    const float certain =
        (clip[i].electrons + within_the_noise * std::sqrt(clip[i].electrons + clip[i].floor_variance)) / t;
    for (std::size_t x = 0; x < size_; ++x)
      if (f[x] == unbounded && sigma[x] < unbounded && radiance[x] - within_the_noise * sigma[x] < certain)
        refine(x, per_radiance, clip, radiance[x], sigma[x]);
  }
}

void ResponseLines::refine(std::size_t x, std::span<const float> per_radiance,
                           std::span<const ClipLevel> clip, float& radiance, float& sigma) const {
  double r = radiance;
  double information = 0.0;
  for (int step = 0; step < newton_steps; ++step) {
    double score = 0.0;
    information = 0.0;
    for (std::size_t i = 0; i < exposures_; ++i) {
      const double t = per_radiance[i];
      const double f = floor_[i * size_ + x];
      if (f < unbounded) {
        const double weighted_t = t / (predicted_[x] * t + f);
        score += weighted_t * (electrons_[i * size_ + x] - t * r);
        information += weighted_t * t;
      } else {
        const double spread = std::sqrt(std::max(r, 0.0) * t + clip[i].floor_variance);
        const double z = (clip[i].electrons - t * r) / spread;
        const double h = hazard(z);
        score += t / spread * h;
        information += t * t / (spread * spread) * h * (h - z);
      }
    }
    r += score / information;
  }
  radiance = static_cast<float>(r);
  sigma = static_cast<float>(1.0 / std::sqrt(information));
}

std::uint32_t ResponseLines::count_useful(std::size_t i, float per_radiance) const {
  const float* f = floor_.data() + i * size_;
  const float share = useful_share / static_cast<float>(exposures_);
  std::uint32_t count = 0;
  for (std::size_t x = 0; x < size_; ++x)
    count += per_radiance * per_radiance > share * information_[x] * (predicted_[x] * per_radiance + f[x]) &&
             f[x] < unbounded;
  return count;
}

}  // namespace refield
