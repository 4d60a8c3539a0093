// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>

#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "core/image/image.h"
#include "core/light/light_map.h"

namespace refield {

/// One light source of a dome or light stage.
struct LightSource {
  int line = 0;               ///< of the list, for messages
  std::string photograph;     ///< file name, without folder; empty where the list has no names
  Eigen::Vector3d direction;  ///< towards the source, unit length, in the axes of lat-long maps
  std::array<float, 3> intensity = {1.0f, 1.0f, 1.0f};  ///< R, G, B, relative, positive
  int column = 0, row = 0;                              ///< its texel
};

/// The light sources of a dome or light stage, photographed one at a time.
struct LightStage {
  std::filesystem::path file;  ///< the list, for messages
  std::vector<LightSource> sources;
  LightDomain domain;              ///< lat-long
  std::vector<std::string> notes;  ///< what the user should know, one sentence each
};

/// Reads the light sources of `file`, recognised from its first line:
///  - one integer: an RTI list (.lp), the number of sources, then `name x y z` per line;
///  - three numbers: directions as in DiLiGenT, `x y z` per line. `filenames.txt` and `light_intensities.txt`
///    (`r g b`, or one value, per line) are read from the same folder, if they exist.
/// Axes of both: x right, y up, z towards the camera. Z is negated, since +Z of a lat-long map is the viewing
/// direction. Lengths are normalised; positions of near sources are thus reduced to directions from the
/// origin. The map has the smallest height of 32, 64, … 512 texels, and twice the width, at which each source
/// has a texel of its own. Throws InputError naming file, line, value and remedy: a wrong count, a value that
/// is no number, no direction, a photograph named twice, two sources in one direction; DeviceError for a
/// missing file.
LightStage read_light_stage(const std::filesystem::path& file);

/// Light map of one source: black but for its texel, which holds its intensity.
Image light_map_of(const LightStage& stage, std::size_t source);

}  // namespace refield
