// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>

#include "core/light/light_map.h"
#include "refield/relight.h"

namespace refield {

/// Where the sun stands when the share `done` (0 to 1) of an equinox day from sunrise to sunset is over.
/// South is ahead (+Z): it rises at the left edge of the view (−X), stands over its middle at noon, and sets
/// at the right.
Eigen::Vector3d sun_direction(double done, const SkyOptions& options);

/// The lat-long map of a clear sky, radiance 1 standing for 1000 cd/m², with the sun `towards_sun` (unit, not
/// below the horizon) as a disc of 0.53° whose energy does not depend on the map's size, and a grey ground
/// of albedo 0.2. Sky: Preetham, Shirley and Smits 1999, appendix A.2; sun: extinction by air
/// and haze as in their appendix A.1, without ozone, water vapour and mixed gases.
LightMap clear_sky(const Eigen::Vector3d& towards_sun, const SkyOptions& options);

}  // namespace refield
