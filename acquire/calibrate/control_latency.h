// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "acquire/calibrate/metering.h"
#include "core/run_context.h"

namespace refield {

/// How long the camera takes to act on its controls.
struct ControlLatency {
  int frames = 0;  ///< begun after a change of exposure that still have the old one, the more of up and down
  std::vector<double>
      level_dn;                 ///< mean of the lit samples by frame, from the change to a longer exposure on
  double expected_ratio = 0.0;  ///< of the two exposures
  double seen_ratio = 0.0;      ///< of the light in their frames
};

/// Step response: a steady scene, the exposure changed, frames counted until the image follows. Trusts the
/// image rather than the exposure that frames state. Throws DeviceError for a camera that ignores its
/// exposure.
ControlLatency measure_control_latency(CalibrationBench& bench, const Metering& metering,
                                       const RunContext& run);

}  // namespace refield
