// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>

#include "relight/relighter.h"

namespace refield::prt_chart {

/// How fast a field over a cube map is relit, in milliseconds; medians.
struct RelightTimes {
  double whole_ms = 0.0;  ///< a new map, from its texels to all outputs
  /// An area light moves by a quarter of its radius: the experiment of Johan and Nishita, section 6.2, with
  /// two round area lights of 5 % and 10 % of a face' side as radius; for both together.
  double two_area_lights_ms = 0.0;
  double update_error = 0.0;  ///< after all moves, against relighting anew: relative RMSE
};

/// How long an action takes.
double seconds_of(const std::function<void()>& action);

/// Of a relighter whose light is a cube map.
RelightTimes measure_relighting(TileRelighter& relighter);

}  // namespace refield::prt_chart
