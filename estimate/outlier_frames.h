// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <string>
#include <vector>

#include "core/run_context.h"
#include "estimate/light_predictor.h"
#include "estimate/pixel_sample.h"

namespace refield {

/// A photograph that does not show what the others predict under its light.
struct OutlierFrame {
  enum class Kind {
    brightness,  ///< the whole picture is brighter or darker: a flicker, a wrong exposure
    light,       ///< the whole picture differs: taken under another light than its light map says
    region       ///< a part of it differs: someone walked by, something moved
  };
  int frame = 0;  ///< number among the frames examined
  Kind kind = Kind::light;
  double times_typical = 0.0;  ///< residual over that of a typical frame; region: in its worst cell
  double residual = 0.0;  ///< median over pixels of |observed − predicted| / predicted; region: in its cells
  std::array<double, 3> brightness{};  ///< median over pixels of observed / predicted − 1, each channel
  double share = 1.0;                  ///< of the picture's cells that differ
  int x = 0, y = 0;                    ///< region: the middle of what differs, pixels
};

/// "41 times the usual residual in 9 % of the picture around (88, 61)": for people.
std::string description_of(const OutlierFrame& outlier);

/// Fewer frames say too little about each other to be judged.
inline constexpr int fewest_frames_to_judge = 10;

struct OutlierSearch {
  std::vector<OutlierFrame> outliers;  ///< in the order of frames
  double typical_residual = 0.0;       ///< median over frames and pixels, relative
  /// More than a quarter of the frames disagree with the rest: there is no majority to trust. They are listed
  /// all the same.
  bool too_many = false;
};

/// Finds frames that do not fit. Each pixel of the sample is predicted under each light from the other frames
/// (light_predictor.h), which is good to the noise for most pixels; frames are then compared by the median
/// standardised residual over the whole picture, and over the worst of its cells, with the spread of the same
/// over all frames (median and MAD of its logarithm). Unusual lights are no outliers: the prediction knows
/// how sure it can be of each. What is found is left out and the search repeated, so that one bad frame
/// neither hides nor makes another. Deterministic.
OutlierSearch find_outlier_frames(const LightGrams& grams, const PixelSample& sample, const RunContext& run);

}  // namespace refield
