// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "acquire/calibrate/bench.h"

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

/// The pattern shown, photographed with all exposures, each `repeats` times; no flat field is applied.
Photograph photograph(CalibrationBench& bench, const CameraCalibration& camera,
                      const std::vector<Seconds>& exposures, int repeats, const RunContext& run = {});

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
  static constexpr double tolerance = 0.01;
  bool holds() const;
  double largest_error() const;  ///< by size
};

/// The test on which everything rests: light adds up, I(A) + I(B) − I(black) = I(A+B) (the linearity of B = T
/// L). Dynamic dimming, power limits and local dimming break it, since A and B are dimmed less than A+B.
/// Pairs: left and right half, upper and lower, the squares of a chequerboard, a small square and its
/// surround.
Superposition measure_superposition(CalibrationBench& bench, const CameraCalibration& camera,
                                    const std::vector<Seconds>& exposures, const RunContext& run = {});

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
