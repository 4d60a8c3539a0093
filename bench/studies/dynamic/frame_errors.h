// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

#include "bench/studies/dynamic/bounce_reference.h"
#include "cli/dynamic/prepared_scene.h"

namespace refield::studies {

/// Milliseconds, medians over frames spread over the scene's motion.
struct FrameTimes {
  double frame = 0.0;  ///< the parts below together, without the picture
  double direct = 0.0, place = 0.0, bounces = 0.0, shade = 0.0;  ///< dynamic::DynamicLight::Times
  double picture = 0.0;  ///< what rasterising the picture takes on top
};
using cli::camera_of;
using cli::PreparedScene;

FrameTimes measure_frames(PreparedScene& scene, const dynamic::FrameOptions& options);

/// What paths say of one moment: the same for all settings.
struct FrameReference {
  double time = 0.0;
  PinholeCamera camera;
  std::vector<dynamic::PathStart> vertices;  ///< up to 500 that face the camera, drawn evenly by a fixed seed
  std::vector<std::size_t> number;           ///< [vertices], in all of the scene's
  std::vector<std::vector<Eigen::Array3f>> bounces;  ///< [bounces + 1][vertices], radiance to the camera
};
FrameReference frame_reference(const PreparedScene& scene, double time, int bounces, int paths);

struct LightError {
  std::string what;       ///< "direct", "bounce 1" …, "bounced" (all but direct), "all"
  double relative = 0.0;  ///< RMSE over that light itself
  double of_all = 0.0;    ///< over all light
  double share = 0.0;     ///< that the light has in all
};
/// The picture of a time by traced paths, as many for each vertex: the reference for
/// PreparedScene::picture().
Image traced_picture(PreparedScene& scene, double time, int bounces, int paths);

/// Solves the reference's moment and compares.
std::vector<LightError> frame_errors(PreparedScene& scene, const FrameReference& reference,
                                     dynamic::FrameOptions options);

}  // namespace refield::studies
