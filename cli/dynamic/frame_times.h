// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "cli/dynamic/prepared_scene.h"

namespace refield::cli {

/// Milliseconds, medians over frames spread over the scene's motion.
struct FrameTimes {
  double frame = 0.0;  ///< the parts below together, without the picture
  double direct = 0.0, place = 0.0, bounces = 0.0, shade = 0.0;  ///< dynamic::DynamicLight::Times
  double picture = 0.0;  ///< what rasterising the picture takes on top
};
FrameTimes measure_frames(PreparedScene& scene, const dynamic::FrameOptions& options);

}  // namespace refield::cli
