// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>

#include "acquire/calibrate/bench.h"
#include "acquire/calibrate/response.h"
#include "core/base/run_context.h"

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

/// A frame taken while the display changes.
struct ChangeFrame {
  double start_s = 0.0;  ///< of the exposure, from the flip's time stamp on
  double exposure_s = 0.0;
  double share = 0.0;  ///< of the new light in it: 0 before the change, 1 after
};

/// A change of light as capture waits for it.
struct DisplayTransition {
  Seconds latency{0};     ///< from the flip's time stamp to the first changed light
  Seconds settling{0};    ///< from there to the last
  double residual = 0.0;  ///< RMS of shares about the fit
};

struct DisplayTiming {
  DisplayTransition rise;  ///< black to grey
  DisplayTransition fall;
  Seconds latency{0};                        ///< the earlier of both
  Seconds settling{0};                       ///< until the later of both has settled
  std::vector<ChangeFrame> rising, falling;  ///< what it rests on
};

/// Fits a change that starts after a latency and goes on evenly while it settles. What a frame holds of it is
/// the integral over its exposure, so that frames much longer than the change, and a camera that runs in step
/// with the display, tell it as well. Settling is then prolonged until no frame beyond it is off by more than
/// `tolerance` (a slow tail). Times are sought in [0, longest].
DisplayTransition fit_light_change(const std::vector<ChangeFrame>& frames, Seconds longest, double tolerance);

/// Shows black and grey in turn and takes frames with exposures of all lengths across the change; pairs them
/// by time stamps alone. Throws DeviceError when the light still changes after the bench's patience, or has
/// not changed at all.
DisplayTiming measure_display_timing(CalibrationBench& bench, const CameraResponse& response,
                                     Seconds exposure_unit, const RunContext& run);

}  // namespace refield
