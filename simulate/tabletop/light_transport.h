// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <memory>
#include <vector>

#include "simulate/tabletop/scene.h"
#include "simulate/tabletop/transport_row.h"

namespace refield {

/// How much work tracing may spend.
struct TraceOptions {
  int pixel_grid = 2;       ///< samples per pixel: pixel_grid², stratified
  int specular_grid = 5;    ///< the same for pixels in which a sample meets glass or a mirror
  int secondary_rays = 16;  ///< for interreflection, a sample
  int caustic_rays = 24;    ///< towards glass and mirrors, a sample: at most that many for each object
  double tolerance =
      0.3;               ///< a box is divided while the integrand varies by more than this share over it ...
  double energy = 4e-4;  ///< ... and that variation is more than this share of the pixel's light
  bool centre_samples = true;  ///< look at the centres of boxes too, not only at their corners
  int depth = 4;               ///< surfaces a path may meet after the first, specular ones not counted
  std::uint64_t seed = 1;
  /// The same random numbers in every pixel: what is left of the sampling error varies smoothly over a
  /// surface instead of showing as grain.
  bool same_paths = false;

  /// `level` 1: quick, for large images; 2: balanced; 3: without grain, for pictures. Throws InputError
  /// otherwise.
  static TraceOptions of_quality(int level, std::uint64_t seed);
};

/// What a pixel sees.
struct PixelTransport {
  std::vector<TransportEntry> entries;  ///< ascending nodes
  Rgb ambient = Rgb::Zero();            ///< room light with the monitor switched off
};

/// Scratch memory of one thread.
class TraceScratch {
 public:
  explicit TraceScratch(const LightHierarchy& hierarchy);
  ~TraceScratch();
  TraceScratch(TraceScratch&&) noexcept;

  std::uint64_t rays() const;  ///< traced so far

  struct Memory;  ///< of light_transport.cpp
  Memory& memory() { return *memory_; }

 private:
  std::unique_ptr<Memory> memory_;
};

/// Traces one camera pixel: from the camera backwards until every path has met the monitor or is lost. The
/// result depends on the options and the pixel alone.
///
/// Light that falls straight from the monitor on a surface is integrated over the boxes of the hierarchy,
/// divided where a shadow's edge crosses them or the integrand varies; behind mirrors and glass it goes to
/// single texels. Light by way of further surfaces comes from random paths (path tracing with next event
/// estimation; Kajiya 1986) and goes to the coarsest boxes, caustics through paths aimed at the glass.
///
/// The boxes *are* the scene's transport matrix by definition: no rendering stands above them. tests/simulate
/// compares them with closed forms and with independent Monte Carlo integration.
PixelTransport trace_pixel(const TabletopScene& scene, const LightHierarchy& hierarchy,
                           const TraceOptions& options, int x, int y, TraceScratch& scratch);

}  // namespace refield
