// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

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
class LightSetup {
 public:
  explicit LightSetup(const LightDomain& domain) : domain_(domain) {}

  const LightDomain& domain() const { return domain_; }

  /// Radiance of every texel, beside all else.
  double ambient() const { return ambient_; }
  void set_ambient(double radiance) { ambient_ = radiance; }

  /// The map behind the light sources; none at first. Throws InputError when it does not fit the domain.
  void set_map(std::optional<LightMap> map);
  bool has_map() const { return map_ || environment_; }
  const std::shared_ptr<const LightMap>& map() const { return map_; }
  /// An environment behind the light sources instead, of any size, as `projector` puts it onto this light
  /// map.
  void set_environment(std::shared_ptr<const PreparedEnvironment> environment,
                       std::shared_ptr<const EnvironmentProjector> projector);
  bool has_environment() const { return environment_ != nullptr; }
  const std::shared_ptr<const PreparedEnvironment>& environment() const { return environment_; }
  const std::shared_ptr<const EnvironmentProjector>& projector() const { return projector_; }
  /// How the environment is turned.
  EulerAngles turn() const { return {.yaw = 360.0 * turns_}; }
  /// A factor on the map.
  double map_gain() const { return map_gain_; }
  void set_map_gain(double gain) { map_gain_ = gain; }
  /// The map turned about the vertical axis, 1 = full circle, content moving to the right. A monitor's own
  /// map slides sideways instead, and what leaves on the right enters on the left. Throws InputError for a
  /// cube's own map.
  double turns() const { return turns_; }
  bool can_turn() const {
    return environment_ || (map_ && domain_.parameterisation != Parameterisation::cube);
  }
  void set_turns(double turns);

  const std::vector<PaintedLight>& light_sources() const { return light_sources_; }
  /// Returns the new light source's number, the highest.
  std::size_t add(const PaintedLight& light_source);
  /// Numbers that no light source has are ignored by these two.
  void change(std::size_t number, const PaintedLight& light_source);
  void remove(std::size_t number);
  void remove_all() { light_sources_.clear(); }
  /// The light source at a point, in fractions of width and height; of several the one added last.
  std::optional<std::size_t> light_source_at(double x, double y) const;

  bool operator==(const LightSetup&) const = default;

 private:
  LightDomain domain_;
  double ambient_ = 0.0;
  std::shared_ptr<const LightMap> map_;
  std::shared_ptr<const PreparedEnvironment> environment_;
  std::shared_ptr<const EnvironmentProjector> projector_;  // of the environment
  double map_gain_ = 1.0;
  double turns_ = 0.0;
  std::vector<PaintedLight> light_sources_;
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
  Box everything() const { return {0, 0, setup_.domain().width, setup_.domain().height}; }
  void compose(const Box& box);

  LightMap light_;
  LightSetup setup_;   // as painted
  LightSetup turned_;  // its map as it is in the next
  LightMap behind_;
  EnvironmentShare share_;
};

}  // namespace refield
