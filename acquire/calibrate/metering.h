// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "acquire/calibrate/bench.h"
#include "core/run_context.h"

namespace refield {

/// Light and exposure at which the camera is well lit without clipping, before anything is known of it.
struct Metering {
  std::uint8_t level = 255;  ///< grey level shown
  Seconds exposure{0};       ///< at which the brightest hundredth of the samples reaches 0.6 of full scale
  std::vector<std::uint32_t>
      lit;               ///< samples that respond to the display at least a fifth as much as the brightest
  double lit_dn = 0.0;   ///< their mean under `level`
  double dark_dn = 0.0;  ///< and under black
};

/// Meters under a grey level chosen so that the exposure is about `wanted` or, where white is too dark for
/// that, longer. Throws InputError where the scene is too dark or too bright for the camera, or nothing in it
/// responds to the display; the message says what to change.
Metering meter(CalibrationBench& bench, Seconds wanted, const RunContext& run = {});

}  // namespace refield
