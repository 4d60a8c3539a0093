// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>
#include <optional>
#include <vector>

#include "core/light_map.h"
#include "relight/environment.h"
#include "relight/viewer/lamp.h"

namespace refield {

/// The box around both; either may be missing.
std::optional<Box> united(const std::optional<Box>& a, const std::optional<Box>& b);

/// A light map made of parts that can be moved: ambient light, a loaded map behind, lamps in front. Changes
/// cost what they touch, and are remembered as a box until taken. Texels are always made anew from the parts,
/// so that no rounding adds up.
class LightPainter {
 public:
  explicit LightPainter(const LightDomain& domain);

  const LightDomain& domain() const { return domain_; }
  const LightMap& light() const { return light_; }

  /// Radiance of every texel, beside all else.
  double ambient() const { return ambient_; }
  void set_ambient(double radiance);

  /// The map behind the lamps; none at first. Throws InputError when it does not fit the domain.
  void set_map(std::optional<LightMap> map);
  bool has_map() const { return map_.has_value(); }
  /// Surroundings behind the lamps instead, of any size, as `projector` puts them onto this light map.
  void set_surroundings(LightMap surroundings, std::shared_ptr<const EnvironmentProjector> projector);
  bool has_surroundings() const { return projector_ != nullptr; }
  /// What of the surroundings reaches the light map as it is turned; all of a map.
  const EnvironmentShare& share() const { return share_; }
  /// A factor on the map.
  double map_gain() const { return map_gain_; }
  void set_map_gain(double gain);
  /// The map turned about the vertical axis, 1 = full circle, content moving to the right. A monitor's own
  /// map slides sideways instead, and what leaves on the right enters on the left. Throws InputError for a
  /// cube's own map.
  double turns() const { return turns_; }
  bool can_turn() const { return projector_ || (map_ && domain_.parameterisation != Parameterisation::cube); }
  void set_turns(double turns);

  const std::vector<Lamp>& lamps() const { return lamps_; }
  /// Returns the new lamp's number, the highest.
  std::size_t add(const Lamp& lamp);
  /// Numbers that no lamp has are ignored by these two.
  void change(std::size_t number, const Lamp& lamp);
  void remove(std::size_t number);
  void remove_all();
  /// The lamp at a point, in fractions of width and height; of several the one added last.
  std::optional<std::size_t> lamp_at(double x, double y) const;

  /// Where the light changed since the last call; nothing where it did not.
  std::optional<Box> take_changed();

 private:
  Box everything() const { return {0, 0, domain_.width, domain_.height}; }
  void turn_map();
  void compose(const std::optional<Box>& box);

  LightDomain domain_;
  LightMap light_;
  double ambient_ = 0.0;
  std::optional<LightMap> map_;
  std::shared_ptr<const EnvironmentProjector> projector_;  // of surroundings
  EnvironmentShare share_;
  LightMap turned_;
  double map_gain_ = 1.0;
  double turns_ = 0.0;
  std::vector<Lamp> lamps_;
  std::optional<Box> changed_;
};

}  // namespace refield
