// SPDX-License-Identifier: Apache-2.0
#include "acquire/calibrate/display_timing.h"

#include <algorithm>
#include <cerrno>
#include <cmath>

#include "core/errors.h"
#include "core/run_context.h"

namespace refield {

namespace {

constexpr int flips_each_way = 14;
constexpr double settled_within = 0.01;

/// Integral from −∞ to t of a ramp from 0 at `latency` to 1 at `latency + settling`.
double ramp_integral(double t, double latency, double settling) {
  const double since = t - latency;
  if (since <= 0.0) return 0.0;
  if (since >= settling) return since - settling / 2.0;
  return since * since / (2.0 * settling);
}

double squared_error(const std::vector<ChangeFrame>& frames, double latency, double settling) {
  double sum = 0.0;
  for (const ChangeFrame& frame : frames) {
    const double share = (ramp_integral(frame.start_s + frame.exposure_s, latency, settling) -
                          ramp_integral(frame.start_s, latency, settling)) /
                         frame.exposure_s;
    sum += (frame.share - share) * (frame.share - share);
  }
  return sum;
}

/// One exposure's frames across one change of light.
struct Series {
  std::vector<RawFrame> frames;
  TimePoint flip;
};

Series frames_across(CalibrationBench& bench, std::uint8_t level, Seconds exposure, const RunContext& run) {
  Series series;
  series.flip = bench.show_at_once(level);
  // From frames that waited in the driver on to the first that begins after the patience is over.
  constexpr int most = 2000;
  for (int i = 0; i < most; ++i) {
    series.frames.push_back(bench.next_frame(exposure, run));
    if (series.frames.back().exposure_start - series.flip > bench.patience()) return series;
  }
  throw DeviceError(bench.camera().name, EIO,
                    "sends only frames from before the display's flip; check that camera and display stamp "
                    "times with the same clock");
}

double linear_mean(const RawFrame& frame, const Metering& metering, const CameraResponse& response) {
  double sum = 0.0;
  for (auto s : metering.lit) sum += response.linear_from_dn[frame.samples[s]];
  return sum / static_cast<double>(metering.lit.size());
}

}  // namespace

LightChange fit_light_change(const std::vector<ChangeFrame>& frames, Seconds longest, double tolerance) {
  double latency = 0.0;
  double settling = 1e-4;
  double best = squared_error(frames, latency, settling);
  const auto consider = [&](double l, double s) {
    if (l < 0.0 || s < 1e-4 || l + s > longest.count()) return false;
    const double error = squared_error(frames, l, s);
    if (!(error < best)) return false;
    best = error;
    latency = l;
    settling = s;
    return true;
  };
  const double coarse = longest.count() / 100.0;
  for (int i = 0; i <= 100; ++i)
    for (int j = 0; j <= 100 - i; ++j) consider(i * coarse, std::max(1e-4, j * coarse));
  for (double step = coarse; step > 1e-6;) {  // both ends of the ramp, one at a time and together
    const bool better = consider(latency + step, settling - step) ||
                        consider(latency - step, settling + step) || consider(latency, settling + step) ||
                        consider(latency, settling - step) || consider(latency + step, settling) ||
                        consider(latency - step, settling);
    if (!better) step /= 2.0;
  }
  double end = latency + settling;
  for (const ChangeFrame& frame : frames)
    if (std::abs(frame.share - 1.0) > tolerance)
      end = std::max(end, std::min(frame.start_s, longest.count()));
  return {Seconds(latency), Seconds(end - latency), std::sqrt(best / static_cast<double>(frames.size()))};
}

DisplayTiming measure_display_timing(CalibrationBench& bench, const CameraResponse& response,
                                     Seconds exposure_unit, const RunContext& run) {
  const Metering metering = meter(bench, std::max(3.0 * bench.camera().frame_interval, Seconds(0.1)), run);
  const auto exposures = exposure_series(bench.camera(), metering.exposure / 24.0, metering.exposure,
                                         flips_each_way, exposure_unit);
  DisplayTiming result;
  Progress progress(run, "measuring display latency", exposures.size());
  double noise = 0.0;
  for (Seconds exposure : exposures) {
    bench.show(0);
    bench.frame(exposure, run);  // black has settled, and so has the exposure
    bench.set_exposure(exposure);
    const Series rise = frames_across(bench, metering.level, exposure, run);
    const Series fall = frames_across(bench, 0, exposure, run);
    const double light = linear_mean(rise.frames.back(), metering, response);
    const double dark = linear_mean(fall.frames.back(), metering, response);
    if (light - dark < 1.0)
      throw DeviceError(bench.display().name, EIO,
                        "shows no change of light within " + std::to_string(bench.patience().count()) +
                            " s of a flip; give a longer --patience");
    noise = std::max(noise, 1.0 / std::max(1.0, light - dark));  // a DN
    const auto collect = [&](const Series& series, double from, double to, std::vector<ChangeFrame>& into) {
      for (const RawFrame& frame : series.frames) {
        const double start = Seconds(frame.exposure_start - series.flip).count();
        if (start + frame.exposure.count() > 0.0)
          into.push_back(
              {start, frame.exposure.count(), (linear_mean(frame, metering, response) - from) / (to - from)});
      }
    };
    collect(rise, dark, light, result.rising);
    collect(fall, light, dark, result.falling);
    progress.advance();
  }
  const double tolerance = std::max(settled_within, 4.0 * noise);
  result.rise = fit_light_change(result.rising, bench.patience(), tolerance);
  result.fall = fit_light_change(result.falling, bench.patience(), tolerance);
  result.latency = std::min(result.rise.latency, result.fall.latency);
  result.settling =
      std::max(result.rise.latency + result.rise.settling, result.fall.latency + result.fall.settling) -
      result.latency;
  if (result.latency + result.settling > 0.9 * bench.patience())
    throw DeviceError(bench.display().name, EIO,
                      "is still changing " + std::to_string(bench.patience().count()) +
                          " s after a flip; give a longer --patience, and turn off the display's own fading, "
                          "dynamic contrast and power saving");
  return result;
}

}  // namespace refield
