// SPDX-License-Identifier: Apache-2.0
#include "acquire/calibrate/tone_curve.h"

#include <algorithm>
#include <cerrno>
#include <cmath>

#include "acquire/calibrate/monotone_curve.h"
#include "acquire/hdr/hdr_merge.h"
#include "core/base/errors.h"
#include "core/base/run_context.h"

namespace refield {

namespace {

constexpr std::array<const char*, 3> channel_names = {"red", "green", "blue"};

DriveImage one_channel(const IlluminatorDescription& display, int channel, int level) {
  DriveImage image = uniform_drive(display.width, display.height, 0);
  for (std::size_t i = channel; i < image.levels.size(); i += 3)
    image.levels[i] = static_cast<std::uint8_t>(level);
  return image;
}

/// Share of `full` light in `light`, both above `black`.
double projection(const Photograph& light, const Photograph& full, const Photograph& black) {
  double top = 0.0, bottom = 0.0;
  for (std::size_t i = 0; i < full.radiance.values.size(); ++i) {
    if (std::isinf(light.sigma.values[i]) || std::isinf(full.sigma.values[i])) continue;
    const double expected = full.radiance.values[i] - black.radiance.values[i];
    top += expected * (light.radiance.values[i] - black.radiance.values[i]);
    bottom += expected * expected;
  }
  return bottom > 0.0 ? top / bottom : 0.0;
}

}  // namespace

std::vector<Seconds> bracket_for(CalibrationBench& bench, int count, Seconds exposure_unit,
                                 const RunContext& run) {
  const Metering metering = meter(bench, Seconds(0), run);  // under white
  constexpr double ratio = 4.0;
  return exposure_series(bench.camera(), metering.exposure, metering.exposure * std::pow(ratio, count - 1),
                         count, exposure_unit);
}

Photograph photograph(CalibrationBench& bench, const CameraCalibration& camera,
                      const std::vector<Seconds>& exposures, int repeats, const RunContext& run) {
  std::vector<RawFrame> frames;
  for (Seconds exposure : exposures)
    for (int i = 0; i < repeats; ++i) frames.push_back(bench.frame(exposure, run));
  return merge_exposures(frames, camera);
}

ToneCurve measure_tone_curve(CalibrationBench& bench, const CameraCalibration& camera,
                             const std::vector<Seconds>& exposures, int step, const RunContext& run) {
  ToneCurve result;
  constexpr int repeats = 2;
  bench.show(0);
  const Photograph black = photograph(bench, camera, exposures, 2 * repeats, run);
  Progress progress(run, "measuring tone curves", 3 * (255 / step + 1));
  for (int c = 0; c < 3; ++c) {
    bench.show(one_channel(bench.display(), c, 255));
    const Photograph full = photograph(bench, camera, exposures, 2 * repeats, run);
    std::vector<double> levels = {0.0};
    std::vector<double> light = {0.0};
    for (int level = step; level < 255; level += step) {
      bench.show(one_channel(bench.display(), c, level));
      levels.push_back(level);
      light.push_back(projection(photograph(bench, camera, exposures, repeats, run), full, black));
      result.falls[c] = std::max(result.falls[c], light[light.size() - 2] - light.back());
      progress.advance();
    }
    levels.push_back(255.0);
    light.push_back(1.0);
    for (std::size_t i = 0; i < levels.size(); ++i) result.measured[c].push_back({levels[i], light[i]});
    constexpr double impossible = 0.05;  // of white
    if (result.falls[c] > impossible)
      throw DeviceError(
          bench.display().name, EIO,
          std::string("its ") + channel_names[c] + " channel becomes darker by " +
              std::to_string(100.0 * result.falls[c]) +
              " % of white from one level to a higher one; turn off dynamic contrast and colour "
              "management, and let nothing move");
    for (double& value : light) value = std::clamp(value, 0.0, 1.0);
    const MonotoneCurve curve(levels, never_falling(light));
    for (int level = 0; level < 256; ++level)
      result.light_from_level[c].push_back(static_cast<float>(curve(level)));
  }
  return result;
}

}  // namespace refield
