// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>

#include "acquire/light_probe/mirror_ball.h"
#include "core/light/light_map.h"

namespace refield {

/// One light source of a dome or light stage.
struct LightSource {
  int line = 0;               ///< of the list, for messages
  std::string photograph;     ///< file name, without folder; empty where the list has no names
  Eigen::Vector3d direction;  ///< towards the source, unit length, in the axes of lat-long maps
  /// R, G, B, positive: of the irradiance of a surface at the object that faces the source, in any unit
  std::array<float, 3> intensity = {1.0f, 1.0f, 1.0f};
  int column = 0, row = 0;  ///< its texel
};

/// The light sources of a dome or light stage, photographed one at a time.
struct LightStage {
  fs::path file;  ///< the list, for messages; empty: directions from a mirror ball
  std::vector<LightSource> sources;
  LightDomain domain;              ///< lat-long
  std::vector<std::string> notes;  ///< what the user should know, one sentence each
};

/// Reads the light sources of `file`, recognised from its first line:
///  - one integer: an RTI list (.lp), the number of sources, then `name x y z` per line;
///  - three numbers: directions as in DiLiGenT, `x y z` per line. `filenames.txt` and `light_intensities.txt`
///    (`r g b`, or one value, per line) are read from the same folder, if they exist;
///  - names of columns, separated by commas, semicolons or tabs: file, x, y, z and, for intensities, r, g, b
///    in any order; others are ignored.
/// Axes: x right, y up, z towards the camera. Z is negated, since +Z of a lat-long map is the viewing
/// direction. Without `object`, vectors are directions and their lengths are normalised. With `object`, its
/// position in the axes and unit of the list, they are positions, and the intensities are multiplied by (mean
/// distance / distance)². Throws InputError naming file, line, value and remedy: a wrong count, a value that
/// is no number, no direction, a photograph named twice, two sources in one direction; DeviceError for a
/// missing file.
LightStage read_light_stage(const fs::path& file, const std::optional<Eigen::Vector3d>& object = {});

/// Gives each source a texel of its own, in the map with the smallest height of 128, 256 or 512 texels,
/// and twice the width, at which that is possible. Throws InputError naming two sources that are too close.
void place_sources(LightStage& stage);

/// Light map of one source: black but for its texel, whose radiance × solid angle is the intensity.
Image light_map_of(const LightStage& stage, std::size_t source);

/// A mirror ball beside the object, in the photographs of a light stage.
struct ChromeBall {
  std::optional<ImageCircle> circle;            ///< nullopt: it is found in the mean photograph
  std::optional<double> field_of_view_degrees;  ///< across the photograph's width; nullopt: far camera
};

/// The ball in `mean`, the mean of the photographs under all light sources. With a far camera, directions are
/// relative to that from the ball to the camera, instead of the optical axis. Throws InputError where the
/// ball is not found, or not whole.
MirrorBall locate_ball(const ChromeBall& ball, const Image& mean);

/// Direction towards the light source, unit length, in the axes of lat-long maps, from the highlight on the
/// ball: the centroid of the samples above a quarter of the largest, and those around them. Source: RTI
/// practice, for instance Mudge et al. 2006. The source is taken to be far away: at a distance of d radii of
/// the ball, its direction from the ball's centre differs by up to 1/d. Throws InputError where there is no
/// single highlight.
Eigen::Vector3d light_direction(const Image& photograph, const MirrorBall& ball);

}  // namespace refield
