// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <compare>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "refield/image.h"

/// Incident light: a map of linear RGB radiance [height × width × 3] with what its columns and rows stand
/// for: texels of a monitor, directions of a latitude-longitude map, or the six faces of a cube map.
/// docs/reference/conventions.md shows the axes.
namespace refield {
inline namespace v0_2 {

/// A rectangle of light-map texels, half-open: columns [x0, x1) and rows [y0, y1).
struct Box {
  std::int32_t x0 = 0;
  std::int32_t y0 = 0;
  std::int32_t x1 = 0;
  std::int32_t y1 = 0;

  std::int32_t width() const { return x1 - x0; }
  std::int32_t height() const { return y1 - y0; }
  std::int64_t area() const { return static_cast<std::int64_t>(width()) * height(); }
  bool contains(std::int32_t x, std::int32_t y) const { return x >= x0 && x < x1 && y >= y0 && y < y1; }
  bool inside(std::int32_t map_width, std::int32_t map_height) const {
    return x0 >= 0 && y0 >= 0 && x0 < x1 && y0 < y1 && x1 <= map_width && y1 <= map_height;
  }
  friend auto operator<=>(const Box&, const Box&) = default;
};

/// How the columns and rows of a light map stand for incident light.
///  - monitor: texels of a flat emitter, as someone in front of it sees them.
///  - lat_long: all directions, column c and row r of [0, width] × [0, height] with φ = 2π·c/width and
///  θ = π·r/height: (−sin θ sin φ, cos θ, −sin θ cos φ). Someone inside who looks along +Z (centre column)
///  has +X to the right and +Y above (row 0): not mirrored, thus left-handed axes.
///  - cube: six square faces stacked from top to bottom, +X −X +Y −Y +Z −Z (height = 6 × width), in
///  the layout of OpenGL's cube maps: someone inside sees faces +X −X +Z −Z upright, +Y with −Z and −Y with
///  +Z at its top edge.
enum class Parameterisation { monitor, lat_long, cube };

REFIELD_API std::string_view name_of(Parameterisation parameterisation);
/// Throws InputError for an unknown name.
REFIELD_API Parameterisation parameterisation_from_name(std::string_view name);

/// The domain over which incident light is defined: a light map without its values.
struct LightDomain {
  int width = 0;
  int height = 0;
  Parameterisation parameterisation = Parameterisation::monitor;
  bool operator==(const LightDomain&) const = default;
};

/// Incident illumination: linear RGB radiance, row-major, top row first.
struct LightMap {
  Image radiance;  ///< 3 channels
  Parameterisation parameterisation = Parameterisation::monitor;
  LightDomain domain() const { return {radiance.width, radiance.height, parameterisation}; }
};

/// A light map that another user owns.
struct LightMapView {
  ImageView radiance;  ///< 3 channels
  Parameterisation parameterisation = Parameterisation::monitor;

  LightMapView() = default;
  LightMapView(const ImageView& view, Parameterisation how) : radiance(view), parameterisation(how) {}
  LightMapView(const LightMap& light)  // NOLINT(google-explicit-constructor): wherever a view is taken
      : radiance(light.radiance), parameterisation(light.parameterisation) {}
  LightDomain domain() const { return {radiance.width, radiance.height, parameterisation}; }
};

/// A turn in the axes of light maps (+X right, +Y up, +Z ahead), in degrees, the same
/// for cameras, monitors and maps: first roll, then pitch, then yaw, each about an axis that stands still.
/// Someone who looks ahead and is turned so looks right by yaw, then down by pitch, with his head rolled.
struct REFIELD_API EulerAngles {
  double yaw = 0.0;    ///< to the right, +Z towards +X
  double pitch = 0.0;  ///< down, +Z towards −Y
  double roll = 0.0;   ///< what was right goes up, +X towards +Y

  bool operator==(const EulerAngles&) const = default;

  /// Whether nothing moves, full circles included.
  bool is_none() const;
};

/// Where a monitor stood, as seen from the scene. The scene's axes are those of light maps: +Y up, +Z level,
/// where the camera looks, +X to the camera's right; the origin is the middle of the scene.
///
/// From the origin one looks straight onto the screen's plane when turned by `turn` (all zero: straight
/// ahead, onto a monitor behind the scene); the plane is `distance_mm` away there. The screen's middle lies
/// `offset_x_mm` to the right of and `offset_y_mm` above that point, as the viewer so turned sees it.
struct REFIELD_API MonitorPlacement {
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

  /// Throws InputError naming `name`, the value and its range.
  void check(const std::string& name) const;
};

/// From "520x320@600,yaw=90,pitch=5,roll=0,x=10,y=-20": width × height @ distance in mm, then turn in degrees
/// and offsets in mm, all of which may be left out. Throws InputError that says so.
REFIELD_API MonitorPlacement monitor_placement_from_text(const std::string& text);

/// Reads several placements.
REFIELD_API std::vector<MonitorPlacement> placements_from_texts(const std::vector<std::string>& texts);

/// The text of a placement; angles and offsets of zero are left out.
REFIELD_API std::string text_of(const MonitorPlacement& monitor);

/// Reads a light map: finite, nothing negative. Negative values of lossy compression become zero, with a
/// warning; the channels' means stay. The faces of EXR cube maps (attribute envmap) are put into the layout
/// of Parameterisation::cube. Values are kept as stored, whatever primaries the file states. Throws
/// InputError on NaN, Inf, many negative values, naming the texel, and where the attribute contradicts the
/// parameterisation.
REFIELD_API LightMap read_light_map(const std::filesystem::path& path, Parameterisation parameterisation,
                                    const RunContext& run = {});

}  // namespace v0_2
}  // namespace refield
