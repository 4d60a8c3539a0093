// SPDX-License-Identifier: Apache-2.0
#include "acquire/calibrate/calibrate.h"

#include <cerrno>
#include <cmath>

#include "acquire/calibrate/calibration.h"
#include "core/base/linear_algebra.h"

namespace refield {

namespace {

constexpr int response_exposures = 14;
constexpr int frames_averaged = 10;
constexpr std::size_t sources_taken = 300;
constexpr double linear_within = 2.5e-3;  // of the range, RMS
constexpr double largest_residual = 0.02;
constexpr double margin = 0.01;  // below saturation: a sample that clips now and then averages too low

/// Where samples stand still though the exposure doubles; full scale where none does.
void find_saturation(CalibrationBench& bench, Seconds exposure, Seconds unit, CameraResponse& response,
                     const RunContext& run) {
  const double full = (1 << response.bits) - 1;
  response.saturation_dn = full;
  const auto series = exposure_series(bench.camera(), exposure, 2.0 * exposure, 2, unit);
  if (series.size() < 2) return;
  const auto once = sample_moments(bench, series[0], 2, nullptr, {}, 0.0, run).mean;
  const RawFrame twice = bench.frame(series[1], run);
  std::vector<float> standing;
  for (std::size_t s = 0; s < once.size(); ++s)
    if (once[s] > 0.3 * full && std::abs(twice.samples[s] - once[s]) < 0.002 * full)
      standing.push_back(twice.samples[s]);
  constexpr std::size_t enough = 20;
  if (standing.size() < enough) return;
  response.saturation_seen = true;
  response.saturation_dn = std::floor(quantile_of(std::move(standing), 0.005));
}

/// Lit samples of all brightnesses alike.
std::vector<std::uint32_t> spread_sources(const Metering& metering, const std::vector<float>& mean) {
  std::vector<std::uint32_t> sorted = metering.lit;
  std::ranges::sort(sorted, {}, [&](std::uint32_t s) { return mean[s]; });
  std::vector<std::uint32_t> chosen;
  const std::size_t count = std::min(sources_taken, sorted.size());
  for (std::size_t i = 0; i < count; ++i) chosen.push_back(sorted[i * sorted.size() / count]);
  return chosen;
}

/// Adds what the sources show at a series of exposures under the pattern shown; they are new sources each
/// time.
void add_series(CalibrationBench& bench, const Metering& metering, const std::vector<std::uint32_t>& sources,
                int first, Seconds unit, CameraResponse& response, std::vector<ResponseDatum>& data,
                const RunContext& run) {
  for (Seconds exposure : exposure_series(bench.camera(), metering.exposure / 40.0, 3.0 * metering.exposure,
                                          response_exposures, unit)) {
    const SampleMoments moments = sample_moments(bench, exposure, frames_averaged, nullptr, {}, 0.0, run);
    response.exposures.push_back(moments.exposure);
    for (std::size_t i = 0; i < sources.size(); ++i) {
      const double dn = moments.mean[sources[i]];
      const double spread = std::sqrt(moments.variance[sources[i]]);
      if (dn + 3.0 * spread > (1.0 - margin) * response.saturation_dn) continue;
      data.push_back({first + static_cast<int>(i), moments.exposure.count(), dn,
                      std::max<double>(moments.variance[sources[i]], 1.0 / 12.0) / frames_averaged});
    }
  }
}

void fill_table(const ResponseFit& fit, CameraResponse& response) {
  const double black = response.black_level_dn;
  const double range = response.saturation_dn - black;
  const MonotoneCurve curve(fit.dn, fit.light);
  double squares = 0.0;
  response.linear_from_dn.resize(std::size_t{1} << response.bits);
  for (std::size_t dn = 0; dn < response.linear_from_dn.size(); ++dn) {
    const auto d = static_cast<double>(dn);
    const double light = curve(d);
    response.linear_from_dn[dn] = static_cast<float>(black + range * light);
    if (d >= black && d <= response.saturation_dn)
      squares += std::pow(light - (d - black) / range, 2) / range;
  }
  response.is_linear = std::sqrt(squares) < linear_within;
  if (response.is_linear) response.linear_from_dn = linear_response(response.bits);
}

constexpr int knots = 49;
constexpr double smoothness = 60.0;   // times the data's weight at a knot: smooths over two or three knots
constexpr double model_error = 3e-4;  // of the range: exposures are not exact, either
constexpr int reweightings = 3;

struct Place {
  int knot;
  double above;  // share of the next knot
};

Place place_of(double dn, const std::vector<double>& knot_dn) {
  const double x = (dn - knot_dn.front()) / (knot_dn.back() - knot_dn.front()) * (knots - 1);
  const int knot = std::clamp(static_cast<int>(std::floor(x)), 0, knots - 2);
  return {knot, x - knot};
}

/// Unknowns: g at the knots, then the light of each source for the longest exposure.
class ResponseSystem {
 public:
  ResponseSystem(const std::vector<ResponseDatum>& data, const std::vector<double>& knot_dn)
      : data_(data), knot_dn_(knot_dn) {
    for (const ResponseDatum& datum : data) {
      sources_ = std::max(sources_, datum.source + 1);
      longest_ = std::max(longest_, datum.exposure_s);
    }
  }

  void solve(const std::vector<double>& weights) {
    const int size = knots + sources_;
    normal_ = Eigen::MatrixXd::Zero(size, size);
    for (std::size_t i = 0; i < data_.size(); ++i) {
      const auto [knot, above] = place_of(data_[i].dn, knot_dn_);
      add({{knot, 1.0 - above},
           {knot + 1, above},
           {knots + data_[i].source, -data_[i].exposure_s / longest_}},
          weights[i]);
    }
    const Eigen::VectorXd weight = normal_.diagonal().head(knots);
    constexpr double least = 1e-6;  // where there are no data, any pull will do
    for (int k = 1; k + 1 < knots; ++k)
      if (weight(k) < least * weight.maxCoeff())  // beyond the data a straight line is safer than a parabola
        add({{k - 1, 1.0}, {k, -2.0}, {k + 1, 1.0}}, smoothness * least * weight.maxCoeff());
    for (int k = 1; k + 2 < knots; ++k)
      add({{k - 1, -1.0}, {k, 3.0}, {k + 1, -3.0}, {k + 2, 1.0}},
          smoothness * std::max(weight(k), least * weight.maxCoeff()));
    // The equations hold for any scale of light. Fixing it at one knot would let all others shrink a little,
    // for small light has small errors; so the mean over the data is fixed instead. g(black) = 0 is known.
    Eigen::VectorXd mean = Eigen::VectorXd::Zero(size);
    for (const ResponseDatum& datum : data_) {
      const auto [knot, above] = place_of(datum.dn, knot_dn_);
      mean(knot) += 1.0 - above;
      mean(knot + 1) += above;
    }
    const Eigen::VectorXd solution =
        solve_symmetric(normal_.bottomRightCorner(size - 1, size - 1), mean.tail(size - 1));
    const double top = solution(knots - 2);
    light_.assign(size, 0.0);
    for (int k = 1; k < size; ++k) light_[k] = solution(k - 1) / top;
  }

  double predicted(std::size_t i) const {
    return light_[knots + data_[i].source] * data_[i].exposure_s / longest_;
  }
  double measured(std::size_t i) const {
    const auto [knot, above] = place_of(data_[i].dn, knot_dn_);
    return light_[knot] * (1.0 - above) + light_[knot + 1] * above;
  }
  double slope(std::size_t i) const {
    const int knot = place_of(data_[i].dn, knot_dn_).knot;
    return (light_[knot + 1] - light_[knot]) / (knot_dn_[1] - knot_dn_[0]);
  }
  std::vector<double> curve() const { return {light_.begin(), light_.begin() + knots}; }

 private:
  void add(std::initializer_list<std::pair<int, double>> row, double weight) {
    for (const auto& [a, factor_a] : row)
      for (const auto& [b, factor_b] : row) normal_(a, b) += weight * factor_a * factor_b;
  }

  const std::vector<ResponseDatum>& data_;
  const std::vector<double>& knot_dn_;
  int sources_ = 0;
  double longest_ = 0.0;
  Eigen::MatrixXd normal_;
  std::vector<double> light_;
};

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

BlackLevel measure_black_level(CalibrationBench& bench, const RunContext& run) {
  bench.show(0);
  BlackLevel result;
  const Seconds shortest = bench.camera().shortest_exposure;
  double n = 0.0, t = 0.0, tt = 0.0, b = 0.0, tb = 0.0;  // sums for a straight line
  for (Seconds exposure : exposure_series(bench.camera(), shortest, 4.0 * shortest, 3, Seconds(0))) {
    const SampleMoments moments = sample_moments(bench, exposure, frames_averaged, nullptr, {}, 0.0, run);
    double mean = 0.0, zeros = 0.0;
    for (float dn : moments.mean) {
      mean += dn / static_cast<double>(moments.mean.size());
      zeros += dn < 0.5f;
    }
    if (n == 0.0) result.clipped = zeros / static_cast<double>(moments.mean.size());
    const double time = moments.exposure.count();
    n += 1.0;
    t += time;
    tt += time * time;
    b += mean;
    tb += time * mean;
  }
  const double spread = n * tt - t * t;
  result.dn = spread > 0.0 ? std::max(0.0, (b * tt - t * tb) / spread) : b / n;
  return result;
}

CameraResponse measure_response(CalibrationBench& bench, const BlackLevel& black, Seconds exposure_unit,
                                const RunContext& run) {
  CameraResponse response;
  response.bits = bench.camera().bits;
  response.black_level_dn = black.dn;
  const Metering metering = meter(bench, std::max(Seconds(0.04), 32.0 * exposure_unit), run);
  bench.show(metering.level);
  find_saturation(bench, 6.0 * metering.exposure, exposure_unit, response, run);
  const auto sources = spread_sources(
      metering, sample_moments(bench, metering.exposure, frames_averaged, nullptr, {}, 0.0, run).mean);
  std::vector<ResponseDatum> data;
  // A second, darker level fills the gaps between exposures that are whole multiples of a period.
  constexpr double darker = 0.88;
  for (const double level : {1.0, darker}) {
    bench.show(static_cast<std::uint8_t>(std::round(level * metering.level)));
    const int first = level < 1.0 ? static_cast<int>(sources.size()) : 0;
    add_series(bench, metering, sources, first, exposure_unit, response, data, run);
  }
  const ResponseFit fit = fit_response(data, response.black_level_dn, response.saturation_dn);
  response.residual = fit.residual;
  if (fit.residual > largest_residual)
    throw DeviceError(bench.camera().name, EIO, "brightness does not follow exposure: samples scatter by ",
                      100.0 * fit.residual,
                      " % of the range about any response curve; turn off automatic exposure and gain, "
                      "tone mapping and local contrast, and check that nothing moves");
  fill_table(fit, response);
  const MonotoneCurve curve(fit.dn, fit.light);
  response.darkest_share = 1.0;
  for (std::size_t i = 0; i < data.size(); ++i) {
    response.darkest_share = std::min(response.darkest_share, curve(data[i].dn));
    if (i % std::max<std::size_t>(1, data.size() / 200) == 0)
      response.points.push_back({data[i].dn, curve(data[i].dn)});
  }
  std::ranges::sort(response.points);
  return response;
}

ResponseFit fit_response(const std::vector<ResponseDatum>& data, double black_dn, double saturation_dn) {
  double highest = black_dn;
  for (const ResponseDatum& datum : data) highest = std::max(highest, datum.dn);
  constexpr std::size_t fewest = 4 * knots;
  if (data.size() < fewest || highest - black_dn < 0.5 * (saturation_dn - black_dn))
    throw InputError("the camera's response cannot be fitted: ", data.size(), " samples reach from black at ",
                     black_dn, " DN to ", highest, " DN, of a range to ", saturation_dn,
                     " DN; give it more light or a wider range of exposures");
  ResponseFit fit;
  for (int k = 0; k < knots; ++k) fit.dn.push_back(black_dn + (saturation_dn - black_dn) * k / (knots - 1.0));
  ResponseSystem system(data, fit.dn);
  std::vector<double> weights(data.size(), 1.0);
  for (int round = 0; round <= reweightings; ++round) {
    system.solve(weights);
    for (std::size_t i = 0; i < data.size(); ++i)
      weights[i] = 1.0 / (data[i].variance * system.slope(i) * system.slope(i) + model_error * model_error);
  }
  double squares = 0.0;
  for (std::size_t i = 0; i < data.size(); ++i)
    squares += std::pow(system.measured(i) - system.predicted(i), 2) / static_cast<double>(data.size());
  fit.residual = std::sqrt(squares);
  fit.light = never_falling(system.curve());
  return fit;
}

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
    throw InputError("camera '", bench.camera().name, "': noise does not grow with light (variance ",
                     dark.variance, " DN² in the dark, at most ", brightest,
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
