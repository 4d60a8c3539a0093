// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/light/light_map.h"
#include "relight/environment/environment.h"
#include "relight/environment/prepared_environment.h"
#include "relight/viewer/gui/canvas.h"

namespace refield {

/// A light that someone places on a light map.
struct PaintedLight {
  enum class Shape { bar, spot };

  Shape shape = Shape::spot;
  /// Centre, as fractions of the map's width and height; for a cube of those of the panorama (lat-long) that
  /// LightPanorama shows. A bar has no y.
  double x = 0.5;
  double y = 0.5;
  /// Bar: its width as a fraction of the map's. Spot: its radius as a fraction of the map's height; in a
  /// lat-long map or a cube that is an angle (1 = 180°), so that a spot looks the same from inside wherever
  /// it stands.
  double size = 0.12;
  std::array<float, 3> colour = {1.0f, 1.0f, 1.0f};  ///< linear
  double radiance = 1.0;                             ///< factor on the colour
  bool is_on = true;

  bool operator==(const PaintedLight&) const = default;
};

/// The texels that a light source may light; empty where it lies beside the map. A light source that goes
/// over the edge of a lat-long map, where the map's ends meet, takes the whole width.
std::optional<Box> light_source_box(const PaintedLight& light_source, const LightDomain& domain);

/// Adds a light source's light to the texels inside `within`, a part of the map. Bars reach from edge to
/// edge, and columns that they cover in part are lit in part; spots fade out over their outer fifth (at least
/// one texel), so that what moves slowly moves smoothly.
void add_light_source(const PaintedLight& light_source, const Box& within, LightMap& light);

/// Whether a point of the map, in fractions, lies on the light source; spots can be caught a little outside,
/// too.
bool is_on_light_source(const PaintedLight& light_source, const LightDomain& domain, double x, double y);

/// How a light map is laid before the user: as it stands, but a cube as a panorama (lat-long), in which what
/// is side by side is so on the sphere, too.
class LightPanorama {
 public:
  explicit LightPanorama(const LightDomain& domain);

  /// Of what is shown, in pixels.
  const LightDomain& shown() const { return shown_; }
  bool is_cube() const { return !texel_.empty(); }
  /// A cube's map, any number of channels, as it is shown: each pixel the texel in its middle.
  Image show(const Image& map) const;
  /// The place in the light map, in texels, of a point of what is shown, in its pixels.
  Point texel_at(const Point& shown) const;

 private:
  LightDomain domain_, shown_;
  std::vector<std::uint32_t> texel_;  // [pixels shown], of a cube
};

/// A light map brought to a field's size.
struct FittedLight {
  LightMap light;
  std::string note;  ///< what was done to it: "1024×512 to 800×600, by area, sides cropped"; empty: nothing
};

/// Brings `image` to `domain`'s size, by area, so that no light is lost and small suns stay as bright in all.
/// A monitor shows the middle of a map of other proportions. A lat-long or cube map must have proportions of
/// its kind (2:1 or the field's own, 1:6); throws InputError otherwise.
FittedLight fit_light(const Image& image, const LightDomain& domain);

/// The box around both; either may be missing.
std::optional<Box> united(const std::optional<Box>& a, const std::optional<Box>& b);

/// What a light map is made of: ambient light, a loaded map behind, light sources in front. A value: cheap to
/// change, to copy (maps are shared) and to compare; LightPainter makes the texels.
struct LightSetup {
  explicit LightSetup(const LightDomain& of) : domain(of) {}

  LightDomain domain;
  double ambient = 0.0;  ///< radiance of every texel, beside all else
  /// The map behind the light sources, of the domain; or an environment instead, of any size, as `projector`
  /// puts it onto this light map.
  std::shared_ptr<const LightMap> map = nullptr;
  std::shared_ptr<const PreparedEnvironment> environment = nullptr;
  std::shared_ptr<const EnvironmentProjector> projector = nullptr;
  double map_gain = 1.0;  ///< a factor on the map
  /// The map turned about the vertical axis, 1 = full circle, content moving to the right. A monitor's own
  /// map slides sideways instead, and what leaves on the right enters on the left.
  double turns = 0.0;
  std::vector<PaintedLight> light_sources{};

  bool has_map() const { return map || environment; }
  /// Replaces the map and the environment. Throws InputError when it does not fit the domain.
  void set_map(std::optional<LightMap> light);
  /// How the environment is turned.
  EulerAngles turn() const { return {.yaw = 360.0 * turns}; }
  bool can_turn() const { return environment || (map && domain.parameterisation != Parameterisation::cube); }
  /// Throws InputError for a cube's own map.
  void set_turns(double wanted);
  /// The light source at a point, in fractions of width and height; of several the one added last.
  std::optional<std::size_t> light_source_at(double x, double y) const;

  bool operator==(const LightSetup&) const = default;
};

/// Paints setups onto a light map, one after another; each costs what differs from the one before. Texels are
/// always made anew from the parts, so that no rounding adds up.
class LightPainter {
 public:
  explicit LightPainter(const LightDomain& domain);

  const LightMap& light() const { return light_; }
  const LightSetup& setup() const { return setup_; }
  /// What of the environment reaches the light map as it is turned; all of a map.
  const EnvironmentShare& share() const { return share_; }

  /// Turns or projects the map, where that is another than it was: what paint() begins with. Throws
  /// Interrupted; then nothing has changed.
  void turn_map(const LightSetup& setup, const RunContext& run = {});
  /// Returns where the light changed; nothing where it did not.
  std::optional<Box> paint(const LightSetup& setup, const RunContext& run = {});

 private:
  Box everything() const { return {0, 0, setup_.domain.width, setup_.domain.height}; }
  void compose(const Box& box);

  LightMap light_;
  LightSetup setup_;   // as painted
  LightSetup turned_;  // its map as it is in the next
  LightMap behind_;
  EnvironmentShare share_;
};

}  // namespace refield
