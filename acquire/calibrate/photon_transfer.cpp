// SPDX-License-Identifier: Apache-2.0
#include "acquire/calibrate/photon_transfer.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/base/errors.h"

namespace refield {

namespace {

constexpr int noise_frames = 12;
constexpr int photon_transfer_exposures = 10;
constexpr int bins = 40;
// Of the range. Assessed by the mean: leaving out frames or samples by their own spread would make noise look
// small.
constexpr double far_from_clipping = 0.8;

struct Bin {
  double signal = 0.0;
  double variance = 0.0;
  double count = 0.0;
};

/// Variance of rounding a sample, in linear DN².
class Rounding {
 public:
  explicit Rounding(const std::vector<float>& linear) : linear_(linear) {}
  double variance_at(double dn) const { return step_at(dn) * step_at(dn) / 12.0; }
  double step_at(double dn) const {
    const auto i = static_cast<std::size_t>(std::clamp(dn, 1.0, static_cast<double>(linear_.size()) - 2.0));
    return (linear_[i + 1] - linear_[i - 1]) / 2.0;
  }
  /// The raw sample whose linear value is nearest above.
  double dn_of(double linear) const {
    return static_cast<double>(std::ranges::lower_bound(linear_, static_cast<float>(linear)) -
                               linear_.begin());
  }

 private:
  const std::vector<float>& linear_;
};

/// Variance of a normal variable from that of its rounded values, DN². Rounding adds 1/12 and, for noise of
/// less than half a step, a term that goes with the place of the mean between two steps: `phase` is the mean
/// of cos(2π mean). (First harmonic of the characteristic function; Widrow and Kollár 2008, chapter 4.)
double unrounded_variance(double rounded, double phase) {
  const auto rounded_from = [&](double variance) {
    const double pi2 = std::numbers::pi * std::numbers::pi;
    return variance + 1.0 / 12.0 - (1.0 / pi2 + 4.0 * variance) * std::exp(-2.0 * pi2 * variance) * phase;
  };
  double low = 0.0, high = rounded;
  for (int i = 0; i < 50; ++i) {
    const double middle = (low + high) / 2.0;
    (rounded_from(middle) < rounded ? low : high) = middle;
  }
  return (low + high) / 2.0;
}

/// Signal (ambient light alone) and variance under black at the shortest exposure, rounding taken off.
Bin dark_variance(CalibrationBench& bench, const CameraResponse& response, const Rounding& rounding,
                  const RunContext& run) {
  bench.show(0);
  const SampleMoments dark =
      sample_moments(bench, bench.camera().shortest_exposure, 2 * noise_frames, nullptr, {}, 0.0, run);
  const auto count = static_cast<double>(dark.variance.size());
  double mean = 0.0, variance = 0.0, phase = 0.0;
  for (std::size_t s = 0; s < dark.variance.size(); ++s) {
    mean += dark.mean[s] / count;
    variance += dark.variance[s] / count;
    phase += std::cos(2.0 * std::numbers::pi * dark.mean[s]) / count;
  }
  const double step = rounding.step_at(mean);
  return {std::max(0.0, (mean - response.black_level_dn) * step),
          unrounded_variance(variance, phase) * step * step, count};
}

/// Slope of the line through `dark` that comes nearest to the curve. A variance from some frames of N samples
/// scatters in proportion to its expected value over √N.
double slope_through(const Bin& dark, const std::vector<Bin>& curve) {
  double slope = 0.0;
  for (int round = 0; round < 3; ++round) {
    double top = 0.0, bottom = 0.0;
    for (const Bin& bin : curve) {
      const double expected = slope > 0.0 ? dark.variance + slope * (bin.signal - dark.signal) : bin.variance;
      const double weight = bin.count / (expected * expected);
      if (!(expected > 0.0)) continue;
      top += weight * (bin.signal - dark.signal) * (bin.variance - dark.variance);
      bottom += weight * (bin.signal - dark.signal) * (bin.signal - dark.signal);
    }
    slope = bottom > 0.0 ? top / bottom : 0.0;
  }
  return slope;
}

std::vector<Bin> lit_variances(CalibrationBench& bench, const Metering& metering,
                               const CameraResponse& response, const Rounding& rounding, Seconds unit,
                               const RunContext& run) {
  const auto& linear = response.linear_from_dn;
  const double top = linear[static_cast<std::size_t>(response.saturation_dn)] - response.black_level_dn;
  std::vector<Bin> sums(bins);
  bench.show(metering.level);
  for (Seconds exposure : exposure_series(bench.camera(), metering.exposure / 40.0, 2.0 * metering.exposure,
                                          photon_transfer_exposures, unit)) {
    const SampleMoments moments =
        sample_moments(bench, exposure, noise_frames, &linear, metering.lit, response.black_level_dn, run);
    for (auto s : metering.lit) {
      const double signal = moments.mean[s] - response.black_level_dn;
      if (signal < 0.0 || signal > far_from_clipping * top) continue;
      Bin& bin = sums[std::min(bins - 1, static_cast<int>(bins * signal / top))];
      bin.signal += signal;
      bin.variance += moments.variance[s] - rounding.variance_at(rounding.dn_of(moments.mean[s]));
      bin.count += 1.0;
    }
  }
  constexpr double fewest = 30.0;
  std::erase_if(sums, [](const Bin& bin) { return bin.count < fewest; });
  for (Bin& bin : sums) {
    bin.signal /= bin.count;
    bin.variance /= bin.count;
  }
  return sums;
}

}  // namespace

PhotonTransfer measure_photon_transfer(CalibrationBench& bench, const Metering& metering,
                                       const CameraResponse& response, Seconds exposure_unit,
                                       const RunContext& run) {
  const Rounding rounding(response.linear_from_dn);
  const Bin dark = dark_variance(bench, response, rounding, run);
  const std::vector<Bin> curve = lit_variances(bench, metering, response, rounding, exposure_unit, run);
  const double slope = slope_through(dark, curve);
  PhotonTransfer result;
  double brightest = 0.0;
  for (const Bin& bin : curve) {
    brightest = std::max(brightest, bin.variance);
    result.points.push_back({bin.signal, bin.variance});
  }
  constexpr double least_growth = 2.0;
  if (!(slope > 0.0) || brightest < least_growth * dark.variance)
    throw InputError("camera '" + bench.camera().name + "': noise does not grow with light (variance " +
                     std::to_string(dark.variance) + " DN² in the dark, at most " +
                     std::to_string(brightest) +
                     " DN² in the light), so photon transfer cannot be measured. Denoised, sharpened or "
                     "compressed frames have this effect: choose a raw format and turn denoising off");
  // The dark frames' ambient light has noise, too.
  const double read = std::max(0.0, dark.variance - slope * dark.signal);
  const double gain = bench.gain();
  result.electrons_per_dn = gain / slope;
  result.read_noise_electrons = std::sqrt(read) / slope;
  const double range =
      response.linear_from_dn[static_cast<std::size_t>(response.saturation_dn)] - response.black_level_dn;
  result.full_well_electrons = range / slope;
  const Bin& last = curve.back();
  result.excess_at_the_top = last.variance / (read + slope * last.signal) - 1.0;
  return result;
}

}  // namespace refield
