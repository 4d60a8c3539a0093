// SPDX-License-Identifier: Apache-2.0
#include "acquire/calibrate/control_latency.h"

#include <algorithm>
#include <cerrno>
#include <cmath>

#include "core/errors.h"

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

}  // namespace refield
