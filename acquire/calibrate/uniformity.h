// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "acquire/calibrate/tone_curve.h"
#include "core/run_context.h"

namespace refield {

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
