// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>

#include "refield/light_map.h"

namespace refield {

class ConfigSection;

/// Takes what was to where it goes: rotation_of(turn) · (0, 0, 1) is where someone so turned looks.
Eigen::Matrix3d rotation_of(const EulerAngles& turn);

/// The direction, of any length, in which a point of the screen is seen: u from 0 at its left edge to 1 at
/// its right, v from 0 at its top edge to 1 at its bottom, as someone in front of it sees them.
Eigen::Vector3d screen_direction(const MonitorPlacement& monitor, double u, double v);

/// A light map may be of several monitors, or of one that stood in several places: their windows are stacked
/// from top to bottom, each a whole map of the same size. Throws InputError naming `name` unless each
/// placement is sound and the map's parameterisation and height fit their number; none fits always.
void check_placements(std::span<const MonitorPlacement> monitors, const LightDomain& domain,
                      const std::string& name);

/// Reads the keys width_mm … offset_y_mm of a table; false where there is none of them. Angles and offsets
/// may be left out. Throws InputError.
bool read_placement(ConfigSection& section, MonitorPlacement& place);

}  // namespace refield
