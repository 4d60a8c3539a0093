// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/chart/noise_curve.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "core/image/image_io.h"
#include "core/image/metrics.h"

namespace refield::chart {

namespace {

constexpr std::size_t frames_read = 8;
constexpr double bins_per_octave = 2.0;
constexpr std::size_t min_samples = 50;  // for a median that means something

}  // namespace

NoiseCurve::NoiseCurve(std::span<const CaptureFrame> frames) {
  std::map<int, std::vector<float>> bins;
  const std::size_t step = std::max<std::size_t>(1, frames.size() / frames_read);
  for (std::size_t j = 0; j < frames.size(); j += step) {
    const Photograph photograph = read_photograph(frames[j].observed);
    for (std::size_t i = 0; i < photograph.sigma.values.size(); ++i) {
      const float sigma = photograph.sigma.values[i], radiance = photograph.radiance.values[i];
      if (!std::isfinite(sigma) || sigma <= 0.0f || radiance <= 0.0f) continue;
      bins[static_cast<int>(std::floor(bins_per_octave * std::log2(radiance)))].push_back(sigma);
    }
  }
  for (auto& [bin, sigmas] : bins) {
    if (sigmas.size() < min_samples) continue;
    log_radiance_.push_back((bin + 0.5) / bins_per_octave * std::log(2.0));
    log_sigma_.push_back(std::log(quantile(std::move(sigmas), 0.5)));
  }
}

double NoiseCurve::sigma(double radiance) const {
  if (!known()) return 0.0;
  const double at = radiance > 0.0 ? std::log(radiance) : log_radiance_.front();
  const auto above = std::ranges::lower_bound(log_radiance_, at);
  if (above == log_radiance_.begin()) return std::exp(log_sigma_.front());
  if (above == log_radiance_.end()) return std::exp(log_sigma_.back());
  const auto k = static_cast<std::size_t>(above - log_radiance_.begin());
  const double t = (at - log_radiance_[k - 1]) / (log_radiance_[k] - log_radiance_[k - 1]);
  return std::exp((1.0 - t) * log_sigma_[k - 1] + t * log_sigma_[k]);
}

void NoiseCurve::add_to(Image& image, Rng& rng) const {
  if (!known()) return;
  for (float& value : image.values) value += static_cast<float>(sigma(value) * rng.normal());
}

}  // namespace refield::chart
