// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <string>

#include "acquire/light_probe/unwrap.h"

namespace refield {

/// When a light map does not serve estimation.
struct ProbeLimits {
  double most_clipped = 0.0;  ///< solid angle that may rest on clipped samples, fraction of the sphere
  double most_sun = 0.5;      ///< light that may come from within `sun_degrees` of the brightest texel
  double sun_degrees = 3.0;

  /// Throws InputError naming the limit and its range.
  void check() const;
};

struct ProbeVerdict {
  double unseen_fraction = 0.0;                           ///< of the sphere, filled from its surroundings
  double clipped_fraction = 0.0;                          ///< of the sphere
  double sun_fraction = 0.0;                              ///< of all light, from around the brightest texel
  std::array<double, 3> mean_radiance = {0.0, 0.0, 0.0};  ///< over the sphere
  std::string discarded;                                  ///< why; empty: kept
};

/// Judges a filled light map. Over-exposed ones do not state the light that was there; under a bare sun,
/// almost a point, everything else is lost in its noise, so that such maps teach estimation one direction
/// only. Source: Matusik et al. 2004, section 6, "we discarded all of the sky images where only the sun was
/// visible".
ProbeVerdict judge(const SeenLight& light, const ProbeLimits& limits);

/// Throws InputError when the ball cannot give a light map: it reaches beyond the photograph, or has too few
/// pixels. `name` is the photograph's, for the message.
void require_usable(const MirrorBall& ball, int width, int height, const std::string& name);

}  // namespace refield
