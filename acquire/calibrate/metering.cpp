// SPDX-License-Identifier: Apache-2.0
#include "acquire/calibrate/metering.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "core/errors.h"

namespace refield {

namespace {

constexpr double target_share = 0.6;     // of full scale, for the brightest hundredth
constexpr double least_response = 0.05;  // of full scale
constexpr Seconds longest_useful{2.0};   // a calibration has hundreds of frames

double brightness(CalibrationBench& bench, Seconds exposure, const RunContext& run) {
  const RawFrame frame = bench.frame(exposure, run);
  const double full = (1 << bench.camera().bits) - 1;
  return quantile_of({frame.samples.begin(), frame.samples.end()}, 0.99) / full;
}

/// The exposure at which the pattern shown has the target brightness, within the camera's range.
Seconds meter_exposure(CalibrationBench& bench, const RunContext& run) {
  Seconds low = bench.camera().shortest_exposure;
  Seconds high = std::max(low, std::min(bench.camera().longest_exposure, longest_useful));
  for (int i = 0; i < 10; ++i) {
    const Seconds middle(std::sqrt(low.count() * high.count()));
    (brightness(bench, middle, run) > target_share ? high : low) = middle;
  }
  return Seconds(std::sqrt(low.count() * high.count()));
}

std::string percent_text(double share) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f %%", 100.0 * share);
  return text;
}

}  // namespace

Metering meter(CalibrationBench& bench, Seconds wanted, const RunContext& run) {
  Metering result;
  bench.show(result.level);
  result.exposure = meter_exposure(bench, run);
  constexpr std::uint8_t lowest_level = 24;
  constexpr double usual_gamma = 2.2;
  for (int attempt = 0; attempt < 3 && result.exposure < wanted * 0.7 && result.level > lowest_level;
       ++attempt) {
    const double level = result.level * std::pow(result.exposure / wanted, 1.0 / usual_gamma);
    result.level = static_cast<std::uint8_t>(std::max<double>(lowest_level, std::round(level)));
    bench.show(result.level);
    result.exposure = meter_exposure(bench, run);
  }
  const double reached = brightness(bench, result.exposure, run);
  if (reached > 0.9)
    throw InputError("camera '" + bench.camera().name + "': " + percent_text(reached) +
                     " of full scale at its shortest exposure: too bright; close the aperture, lower the "
                     "display's brightness or darken the room");
  constexpr int frames = 4;
  const auto light = sample_moments(bench, result.exposure, frames, nullptr, {}, 0.0, run).mean;
  bench.show(0);
  const auto dark = sample_moments(bench, result.exposure, frames, nullptr, {}, 0.0, run).mean;
  std::vector<float> response(light.size());
  for (std::size_t s = 0; s < light.size(); ++s) response[s] = light[s] - dark[s];
  const double full = (1 << bench.camera().bits) - 1;
  const double most = quantile_of(response, 0.99);
  if (most < least_response * full)
    throw InputError(
        "camera '" + bench.camera().name + "': the display's light changes the image by " +
        percent_text(most / full) + " of full scale at an exposure of " +
        std::to_string(result.exposure.count()) + " s, at least " + percent_text(least_response) +
        " are needed: the scene is too dark, or the room is too bright compared with the display. Check the "
        "lens cap and the framing, open the aperture, raise the display's brightness or the camera's "
        "gain, darken the room");
  for (std::size_t s = 0; s < response.size(); ++s)
    if (response[s] > 0.2 * most) result.lit.push_back(static_cast<std::uint32_t>(s));
  result.lit_dn = mean_over(light, result.lit);
  result.dark_dn = mean_over(dark, result.lit);
  return result;
}

}  // namespace refield
