// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <array>
#include <vector>

#include "acquire/light_probe/mirror_ball.h"
#include "acquire/light_probe/mirror_reflectance.h"
#include "core/image_io.h"
#include "core/metrics.h"
#include "core/turn.h"

namespace refield {

struct UnwrapOptions {
  int width = 512;  ///< of the light map, even; its height is half of it
  MirrorReflectance reflectance = MirrorReflectance::chrome();
  /// What the photograph is multiplied by, each channel: 1 / transmittance of neutral-density filters.
  std::array<double, 3> gain = {1.0, 1.0, 1.0};
  double camera_region_degrees = 5.0;  ///< nothing is taken from within this angle of the camera itself
  double rim_px = 2.0;                 ///< nor from this near to the ball's outline

  /// Throws InputError naming the option and its range.
  void check() const;
};

/// What one or several photographs of the ball say about the surroundings.
struct SeenLight {
  Image radiance;  ///< lat-long [width/2 × width × 3]; 0 where nothing was seen
  /// [width/2 × width × 1]; 0: not seen. Else the share of the texel that was seen times the fourth power of
  /// the ball's resolution there, relative to that in its middle: by it photographs are joined.
  Image weight;
  Mask clipped;  ///< non-zero: rests on samples that were clipped, so the radiance is a lower bound
};

/// The lat-long light map that a photograph of a mirror ball shows, see docs/guide/light-probe.md. `turn` is
/// the camera's: without one its optical axis is the middle of the light map, and +Y is up in the image. Each
/// texel is the mean radiance over its solid angle, by samples no further apart than a third of a pixel, so
/// that small bright sources keep their energy; each sample is divided by the mirror's reflectance at its
/// angle of incidence. `hidden`, empty or as large as the photograph, is non-zero where nothing may be taken
/// from: tripod, stand, photographer. Throws InputError for sizes that do not fit.
SeenLight unwrap(const Photograph& photograph, const MirrorBall& ball, const Turn& turn, const Mask& hidden,
                 const UnwrapOptions& options);

/// One map from photographs from several sides: the mean by weight.
SeenLight join(const std::vector<SeenLight>& views);

/// A width that shows what the ball's middle resolves, rounded to 16, at most 4096.
int natural_width(const MirrorBall& ball);

}  // namespace refield
