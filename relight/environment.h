// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <optional>
#include <span>
#include <vector>

#include "core/light_map.h"
#include "core/monitor_placement.h"
#include "core/turn.h"
#include "relight/sphere_grid.h"

namespace refield {

/// Which kind of map of the whole surroundings has such proportions; nothing: none has.
std::optional<Parameterisation> environment_kind(int width, int height);

/// Reads a map of the whole surroundings: twice as wide as high is lat-long, six times as high as wide a
/// cube. Throws InputError for other proportions, and what read_light_map() does.
LightMap read_environment(const std::filesystem::path& path);

/// What of an environment reaches a field's light map. Energy is radiance times solid angle, all channels
/// together.
struct EnvironmentShare {
  double sphere = 1.0;  ///< of all directions: what the light map's windows cover
  double energy = 1.0;  ///< of the map's light: what comes from there; 1 for a black map
};

struct EnvironmentLight {
  LightMap light;
  EnvironmentShare share;
};

/// A convex part of a texel, and the number of windows that see it.
struct SeenPart {
  SphericalPolygon outline;
  int windows = 1;
};

/// Puts environments onto the light map of a field: a monitor's window as seen from the middle of the scene,
/// several monitors' windows, a lat-long map or a cube. Every texel gets the mean radiance of the environment
/// over its solid angle, by the exact overlaps of texels on the sphere: light is neither lost nor made,
/// whatever the two resolutions, and nothing aliases. Directions that several windows see are shared
/// evenly between them, so that they count once.
class EnvironmentProjector {
 public:
  /// `monitors`: placements where `target` is a monitor map, see check_placements(). Throws InputError where
  /// they are missing.
  EnvironmentProjector(const LightDomain& target, std::span<const MonitorPlacement> monitors);

  /// The light that `environment` gives when it is turned by `turn`: what it shows ahead (+Z) lies at
  /// turn.matrix() · (0, 0, 1) then. An environment of the target's own size and parameterisation that is not
  /// turned is not touched. Throws InputError for an environment that is neither lat-long nor cube,
  /// Interrupted.
  EnvironmentLight project(const LightMap& environment, const Turn& turn) const;

 private:
  std::vector<SeenPart> parts_of(const SphericalPolygon& texel, const SpherePatch& window) const;

  SphereGrid grid_;
};

}  // namespace refield
