// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

namespace refield {

/// A turn in the axes of light maps (lat_long_direction(): +X right, +Y up, +Z ahead), in degrees, the same
/// for cameras, monitors and maps: first roll, then pitch, then yaw, each about an axis that stands still.
/// Someone who looks ahead and is turned so looks right by yaw, then down by pitch, with his head rolled.
struct EulerAngles {
  double yaw = 0.0;    ///< to the right, +Z towards +X
  double pitch = 0.0;  ///< down, +Z towards −Y
  double roll = 0.0;   ///< what was right goes up, +X towards +Y

  bool operator==(const EulerAngles&) const = default;

  /// Takes what was to where it goes: matrix() · (0, 0, 1) is where someone so turned looks.
  Eigen::Matrix3d matrix() const;

  /// Whether nothing moves, full circles included.
  bool is_none() const;
};

class ConfigSection;
struct LightDomain;

/// Where a monitor stood, as seen from the scene. The scene's axes are those of light maps: +Y up, +Z level,
/// where the camera looks, +X to the camera's right; the origin is the middle of the scene.
///
/// From the origin one looks straight onto the screen's plane when turned by `turn` (all zero: straight
/// ahead, onto a monitor behind the scene); the plane is `distance_mm` away there. The screen's middle lies
/// `offset_x_mm` to the right of and `offset_y_mm` above that point, as the viewer so turned sees it.
struct MonitorPlacement {
  double width_mm = 0.0;
  double height_mm = 0.0;
  double distance_mm = 0.0;
  EulerAngles turn{};
  double offset_x_mm = 0.0;
  double offset_y_mm = 0.0;

  bool operator==(const MonitorPlacement&) const = default;

  /// Where the screen's edges lie, in units of the distance: left, right, bottom, top, along the axes of
  /// the viewer who is turned by `turn`.
  double left() const { return (offset_x_mm - 0.5 * width_mm) / distance_mm; }
  double right() const { return (offset_x_mm + 0.5 * width_mm) / distance_mm; }
  double bottom() const { return (offset_y_mm - 0.5 * height_mm) / distance_mm; }
  double top() const { return (offset_y_mm + 0.5 * height_mm) / distance_mm; }

  /// The direction, of any length, in which a point of the screen is seen: u from 0 at its left edge to 1 at
  /// its right, v from 0 at its top edge to 1 at its bottom, as someone in front of it sees them.
  Eigen::Vector3d direction(double u, double v) const;

  /// Throws InputError naming `name`, the value and its range.
  void check(const std::string& name) const;
};

/// A light map may be of several monitors, or of one that stood in several places: their windows are stacked
/// from top to bottom, each a whole map of the same size. Throws InputError naming `name` unless each
/// placement is sound and the map's parameterisation and height fit their number; none fits always.
void check_placements(std::span<const MonitorPlacement> monitors, const LightDomain& domain,
                      const std::string& name);

/// Reads the keys width_mm … offset_y_mm of a table; false where there is none of them. Angles and offsets
/// may be left out. Throws InputError.
bool read_placement(ConfigSection& section, MonitorPlacement& place);

/// From "520x320@600,yaw=90,pitch=5,roll=0,x=10,y=-20": width × height @ distance in mm, then turn in degrees
/// and offsets in mm, all of which may be left out. Throws InputError that says so.
MonitorPlacement monitor_placement_from_text(const std::string& text);

/// Reads several placements.
std::vector<MonitorPlacement> placements_from_texts(const std::vector<std::string>& texts);

/// The text of a placement; angles and offsets of zero are left out.
std::string text_of(const MonitorPlacement& monitor);

}  // namespace refield
