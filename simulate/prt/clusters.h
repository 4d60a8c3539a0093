// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <string_view>

#include "core/field_rows.h"
#include "core/run_context.h"
#include "simulate/prt/transfer_samples.h"

namespace refield::prt {

/// Which outputs decide together how light is clustered.
///  - all_outputs: one clustering for all, by the norm over all outputs (Johan and Nishita, eq. 11).
///  - all_by_solid_angle: the same norm, times the light that a square can bring: a square that is large is
///  cut
///    for less than a small one.
///  - group: each group of 16 neighbours has its own cut through the same quadtrees.
enum class Similarity { all_outputs, all_by_solid_angle, group };

std::string_view name_of(Similarity similarity);

struct ClusterOptions {
  Relighting relighting = Relighting::geometry;
  Similarity similarity = Similarity::group;
  int resolution = 1024;  ///< R: the light has 6 R² texels; 1 to 4096
  int samples = 3;        ///< s: lights tried along a square's side, 2 to 16
  /// What is let pass.
  ///  - all_outputs: ε of eq. 11, ‖T_C − T_l‖ ∕ N < ε for all samples l (and, of an image, each channel).
  ///  - all_by_solid_angle: Ω ‖T_C − T_l‖ ∕ √N < ε for a square of solid angle Ω.
  ///  - group: a square of solid angle Ω is cut while Ω · σ(T) > ε for an output (and channel) of the group,
  ///    σ² being the variance of T over its samples: what the output changes by, of what white would give
  ///    under white light, when the square's light is as strong but comes from elsewhere in it.
  double epsilon = 1e-4;
  int pixel_samples = 1;  ///< image relighting: points along a pixel's side, 1 to 8
  int bounces = 0;        ///< of light between diffuse surfaces; 0 to 16. The paper has none
};

struct ClusterStatistics {
  std::uint64_t clusters = 0;  ///< squares of light in the basis
  std::uint64_t entries = 0;   ///< weights (output × square) that are not zero in some channel
  /// What the paper counts as data: bytes that are not zero once white facing the light is 255, all channels.
  std::uint64_t bytes_of_paper = 0;
  /// Lights whose transfer vectors were computed; with cuts of groups, so many on average.
  double lights = 0.0;
  std::uint64_t rays = 0;
  std::uint64_t peak_vectors = 0;  ///< transfer vectors held at a time; 0 with cuts of groups
  double seconds = 0.0;
};

/// The scene's transfer from squares of a cube map: a field over boxes with Measure::solid_angle; a weight is
/// the mean of T over a square's samples (eq. 10). Throws InputError for options out of range and scenes that
/// do not suit (layout_of()), Interrupted after Ctrl-C. Results do not depend on the number of threads. The
/// rows hold what they need of the scene.
FieldRows cluster_transfer(const Scene& scene, const ClusterOptions& options, ClusterStatistics& statistics,
                           const RunContext& run = {});

}  // namespace refield::prt
