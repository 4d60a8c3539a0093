// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>

#include "acquire/calibrate/tone_curve.h"
#include "core/run_context.h"

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
/// surroundings.
Superposition measure_superposition(CalibrationBench& bench, const CameraCalibration& camera,
                                    const std::vector<Seconds>& exposures, double tolerance,
                                    const RunContext& run = {});

}  // namespace refield
