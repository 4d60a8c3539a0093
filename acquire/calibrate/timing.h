// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "acquire/calibrate/bench.h"
#include "acquire/calibrate/response.h"

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

/// Brightness of one frame beside what its exposure alone would give.
struct ExposedLight {
  double start_s = 0.0;  ///< of the exposure, from any instant on
  double exposure_s = 0.0;
  double light_per_second = 0.0;  ///< in any unit, above 0
};

/// A periodic part of the light: 1 + depth · cos(2π · hz · t + phase).
struct Ripple {
  double hz = 0.0;
  double depth = 0.0;
  /// The most that an exposure's brightness can be off by, relative: depth · |sin(π hz t)| / (π hz t).
  double error_at(Seconds exposure) const;
};

/// How the display's light pulses.
struct Banding {
  Seconds refresh_period{0};         ///< from the flips' time stamps; 0: not known
  std::vector<Ripple> ripples;       ///< strongest first; none where the light is steady
  std::vector<ExposedLight> frames;  ///< what it rests on
  Seconds exposure_unit{0};          ///< whole multiples of it show no ripple; 0: any exposure will do
  std::vector<std::array<double, 2>> deviation;  ///< (exposure in s, relative brightness − 1) of the frames
  double noise = 0.0;                            ///< what of the deviation no ripple explains, RMS
};

/// Takes frames of steady light at irregular exposures and finds the frequencies at which its brightness goes
/// with the start and the length of the exposure (a periodogram by least squares, after Lomb 1976 and Scargle
/// 1982, whose basis functions are integrals over the exposure). Irregular exposures tell frequencies apart
/// that frames at a fixed rate confuse.
Banding measure_banding(CalibrationBench& bench, const Metering& metering, double black_dn,
                        const RunContext& run);

/// The same once the camera's response is known: depths are then of light, not of DN.
Banding linearised(Banding banding, double black_dn, const std::vector<float>& linear_from_dn);

/// The ripples in `light`, strongest first, at most `most`; frequencies from 20 Hz to 2 kHz. `unexplained`,
/// when given, receives the RMS of what is left, relative.
std::vector<Ripple> find_ripples(const std::vector<ExposedLight>& light, int most,
                                 double* unexplained = nullptr);

/// The shortest exposure, a whole number of periods of one ripple, at which and at whose multiples all
/// ripples stay below `tolerance`; 0 where there is no ripple.
Seconds exposure_unit_for(const std::vector<Ripple>& ripples, double tolerance);

/// The longest period of which all differences are whole multiples, from differences that are at most a few
/// periods long; 0 where there is none.
Seconds common_period(const std::vector<Seconds>& differences);

}  // namespace refield
