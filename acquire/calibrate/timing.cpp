// SPDX-License-Identifier: Apache-2.0
#include "acquire/calibrate/timing.h"

#include <algorithm>
#include <cerrno>
#include <cmath>

#include "core/base/errors.h"
#include "core/base/run_context.h"

namespace refield {

namespace {

constexpr int frames_watched = 24;
constexpr int frames_compared = 4;  // the last ones: what the step ends at
constexpr double arrived =
    0.2;  // of the step may be missing: a pulsing backlight makes single frames uncertain
constexpr double step_ratio = 4.0;

/// Levels of the frames that begin after the exposure was set.
std::vector<double> levels_after(CalibrationBench& bench, const Metering& metering, Seconds exposure,
                                 const RunContext& run) {
  std::vector<double> levels;
  const TimePoint made = bench.set_exposure(exposure);
  for (int i = 0; i < 8 * frames_watched && static_cast<int>(levels.size()) < frames_watched; ++i) {
    const RawFrame frame = bench.next_frame(metering.exposure, run);
    if (frame.exposure_start >= made) levels.push_back(mean_over(frame, metering.lit));
  }
  if (static_cast<int>(levels.size()) < frames_watched)
    throw DeviceError(bench.camera().name, EIO,
                      "sends only frames that started before its settings changed; check that its time "
                      "stamps use the monotonic clock");
  return levels;
}

double end_of(const std::vector<double>& levels) {
  double sum = 0.0;
  for (int i = 1; i <= frames_compared; ++i) sum += levels[levels.size() - i];
  return sum / frames_compared;
}

/// The number of frames before the level stays near its end.
int frames_until(const std::vector<double>& levels, double from) {
  const double to = end_of(levels);
  int last = -1;
  for (std::size_t i = 0; i < levels.size(); ++i)
    if (std::abs(levels[i] - to) > arrived * std::abs(to - from)) last = static_cast<int>(i);
  return last + 1;
}

}  // namespace

ControlLatency measure_control_latency(CalibrationBench& bench, const Metering& metering,
                                       const RunContext& run) {
  const Seconds longer = metering.exposure;
  const Seconds shorter = std::max(bench.camera().shortest_exposure, longer / step_ratio);
  bench.show(metering.level);
  bench.frame(shorter, run);  // waits until the light stands still
  const auto dark_first = levels_after(bench, metering, shorter, run);
  ControlLatency result;
  result.level_dn = levels_after(bench, metering, longer, run);
  const auto down = levels_after(bench, metering, shorter, run);
  result.expected_ratio = longer / shorter;
  const double low = end_of(dark_first);
  const double high = end_of(result.level_dn);
  result.seen_ratio = (high - metering.dark_dn) / std::max(1e-9, low - metering.dark_dn);
  // The response may bend: an exposure four times as long is rarely four times as bright in DN, but brighter.
  if (low - metering.dark_dn > 0.0 && result.seen_ratio < 1.0 + 0.1 * (result.expected_ratio - 1.0))
    throw DeviceError(bench.camera().name, EIO,
                      "ignores its exposure: " + std::to_string(longer.count()) + " s is as bright as " +
                          std::to_string(shorter.count()) +
                          " s; turn off automatic exposure and gain, and dynamic frame rate");
  result.frames = std::max(frames_until(result.level_dn, low), frames_until(down, high));
  if (result.frames > frames_watched - 2 * frames_compared)
    throw DeviceError(bench.camera().name, EIO,
                      "is still changing its brightness " + std::to_string(frames_watched) +
                          " frames after its exposure was set; turn off automatic exposure and gain");
  return result;
}

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

DisplayTransition fit_light_change(const std::vector<ChangeFrame>& frames, Seconds longest,
                                   double tolerance) {
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
