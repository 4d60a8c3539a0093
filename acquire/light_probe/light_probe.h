// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "acquire/light_probe/mirror_ball.h"
#include "acquire/light_probe/unwrap.h"

namespace refield {

/// When a light map does not serve estimation.
struct ProbeLimits {
  double max_clipped = 0.0;  ///< solid angle that may rest on clipped samples, fraction of the sphere
  double max_sun = 0.5;      ///< light that may come from within 3 degrees of the brightest texel

  /// Throws InputError naming the limit and its range.
  void check() const;
};

struct ProbeVerdict {
  double unseen_fraction = 0.0;                           ///< of the sphere, filled from its environment
  double clipped_fraction = 0.0;                          ///< of the sphere
  double sun_fraction = 0.0;                              ///< of all light, from around the brightest texel
  std::array<double, 3> mean_radiance = {0.0, 0.0, 0.0};  ///< over the sphere
  std::string discarded;                                  ///< why; empty: kept
};

/// Assesses a filled light map. Over-exposed ones do not state the light that was there; under a bare sun,
/// almost a point, everything else is lost in its noise, so that such maps teach estimation one direction
/// only. Source: Matusik et al. 2004, section 6, "we discarded all of the sky images where only the sun was
/// visible".
ProbeVerdict assess(const SeenLight& light, const ProbeLimits& limits);

/// Throws InputError when the ball cannot give a light map: it reaches beyond the photograph, or has too few
/// pixels. `name` is the photograph's, for the message.
void require_usable(const MirrorBall& ball, int width, int height, const std::string& name);

/// A camera in front of the ball and its photographs, one after another.
struct ProbeSide {
  std::vector<fs::path> photographs;  ///< linear radiance (OpenEXR)
  EulerAngles turn;
  std::optional<double> field_of_view_degrees;  ///< across the photograph's width, or
  std::optional<double> distance_radii;         ///< just one of the two
  std::optional<ImageCircle> ball;              ///< where the ball is; none: it is found
  std::optional<fs::path> hidden;               ///< mask of what to leave out, white
};

struct ProbeRequest {
  std::vector<ProbeSide> sides;  ///< one, or several with equally many photographs, joined one by one
  UnwrapOptions unwrap;          ///< width 0: natural_width()
  ProbeLimits limits;
  bool ball_moves = false;  ///< find it in each photograph anew; else the median place serves all
  std::optional<double>
      saturation;        ///< photographs that do not state their noise: clipped from this value on
  fs::path folder;       ///< gets NAME.exr for each photograph kept, times.tsv and probe.toml
  bool replace = false;  ///< of what an earlier run left there
};

struct ProbedPhotograph {
  fs::path photograph;  ///< of the first side
  ImageCircle ball;
  ProbeVerdict verdict;
};

struct ProbeSummary {
  std::vector<ProbedPhotograph> photographs;
  int width = 0;                   ///< of the light maps
  std::vector<std::string> notes;  ///< what the user should know
  std::size_t kept() const;
};

/// Turns photographs of a mirror ball into lat-long light maps, see docs/guide/light-probe.md. Maps are
/// written one by one, each atomically; maps of discarded photographs are not written. Throws InputError,
/// FormatError or DeviceError.
ProbeSummary probe_light(const ProbeRequest& request, const RunContext& run = {});

}  // namespace refield
