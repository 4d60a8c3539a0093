// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "cli/relight/camera_options.h"
#include "core/turn.h"
#include "relight/sky.h"
#include "relight/video.h"

namespace refield::cli {

/// Options of `refield relight`.
struct RelightOptions {
  std::filesystem::path field;
  std::vector<std::string> lights;        ///< light maps of the field's own size
  std::vector<std::string> environments;  ///< maps of the surroundings, of any size
  std::vector<std::string> monitors;      ///< placements, in place of the field's own
  Turn turn;                              ///< of environments
  bool exact = false;                     ///< project environments texel by texel
  std::filesystem::path area_lights;      ///< lamps around a mesh, as a file describes them
  double bar = 0.0;                       ///< width as a fraction of the light map; 0: no bar
  bool rotate = false;
  bool fade = false;  ///< from each environment to the next
  bool day = false;   ///< a sky from sunrise to sunset
  SkyOptions sky;
  CameraOptions camera;
  int frames = 0;
  std::filesystem::path output;
  std::string format = "exr";
  VideoOptions video;  ///< its exposure goes for PNG files too
};

}  // namespace refield::cli
