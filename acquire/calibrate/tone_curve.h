// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>

#include "acquire/calibrate/bench.h"
#include "core/base/run_context.h"

namespace refield {

/// How the display turns drive levels into light.
struct ToneCurve {
  /// [3][256] light above black, 1 at level 255 of each channel.
  std::array<std::vector<float>, 3> light_from_level;
  std::array<std::vector<std::array<double, 2>>, 3>
      measured;                   ///< (level, light) of the levels that were shown
  std::array<double, 3> falls{};  ///< largest fall of light from a level to a higher one, share of white
};

/// Shows each channel alone at levels `step` apart and photographs it with several exposures. Light is what
/// the photograph has in common with that of the full level (projection, weighted by signal): cross-talk of
/// the camera's colour filters does no harm. In between the curve is monotone cubic. `exposures`: growing;
/// `camera` linearises. Throws DeviceError for a channel whose light does not grow.
ToneCurve measure_tone_curve(CalibrationBench& bench, const CameraCalibration& camera,
                             const std::vector<Seconds>& exposures, int step, const RunContext& run);

/// Exposures of photographs of light up to white: the metered one and longer ones, four times apart.
std::vector<Seconds> bracket_for(CalibrationBench& bench, int count, Seconds exposure_unit,
                                 const RunContext& run);

/// The pattern shown, photographed with all exposures, each `repeats` times; no flat field is applied.
Photograph photograph(CalibrationBench& bench, const CameraCalibration& camera,
                      const std::vector<Seconds>& exposures, int repeats, const RunContext& run = {});

}  // namespace refield
