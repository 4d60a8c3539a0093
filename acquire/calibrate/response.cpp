// SPDX-License-Identifier: Apache-2.0
#include "acquire/calibrate/response.h"

#include <algorithm>
#include <cerrno>
#include <cmath>

#include "acquire/calibrate/monotone_curve.h"
#include "core/errors.h"

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
    throw DeviceError(bench.camera().name, EIO,
                      "brightness does not follow exposure: samples scatter by " +
                          std::to_string(100.0 * fit.residual) +
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

}  // namespace refield
