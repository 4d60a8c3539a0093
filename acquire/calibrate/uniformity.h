// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "acquire/calibrate/tone_curve.h"
#include "core/base/run_context.h"

namespace refield {

/// Two patterns that share no texel, and their sum.
struct SuperpositionPair {
  std::string name;
  double error = 0.0;  ///< (I(A) + I(B) − I(black) − I(A+B)) / (I(A+B) − I(black)) over all lit samples
  double uncertainty = 0.0;  ///< standard deviation of it
  double worst_block =
      0.0;  ///< of 6 × 4 blocks of the frame, the largest error by size that noise cannot explain
};

struct Superposition {
  std::vector<SuperpositionPair> pairs;
  double tolerance = 0.01;
  bool holds() const;
  double largest_error() const;  ///< by size
};

/// The test on which everything rests: light adds up, I(A) + I(B) − I(black) = I(A+B) (the linearity of B = T
/// L). Dynamic dimming, power limits and local dimming break it, since A and B are dimmed less than A+B.
/// Pairs: left and right half, upper and lower, the squares of a chequerboard, a small square and its
/// surround.
Superposition measure_superposition(CalibrationBench& bench, const CameraCalibration& camera,
                                    const std::vector<Seconds>& exposures, double tolerance,
                                    const RunContext& run = {});

/// A map of brightness over the frame or the screen.
struct UniformityMap {
  RelativeMap map;
  double least = 1.0;    ///< the map's lowest value; its highest is 1
  double texture = 0.0;  ///< RMS of what is no smooth map, relative, noise not counted
};

/// Vignetting: the camera looks at something plain that the display lights evenly, such as white card, best
/// out of focus. What varies smoothly over the photograph is the lens (and how evenly the card is lit: keep
/// it small and far from the display). Throws InputError for a target that is not plain.
UniformityMap measure_flat_field(CalibrationBench& bench, const CameraCalibration& camera,
                                 const std::vector<Seconds>& exposures, const RunContext& run = {});

/// Uniformity of the screen: the camera looks at the display itself. A white square is shown at each place of
/// a grid; its mean brightness in the photograph, divided by the camera's flat field, is the screen's there.
/// Throws InputError when places cannot be seen.
UniformityMap measure_screen_uniformity(CalibrationBench& bench, const CameraCalibration& camera,
                                        const std::vector<Seconds>& exposures, const RunContext& run = {});

}  // namespace refield
