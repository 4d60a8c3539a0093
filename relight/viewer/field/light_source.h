// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <optional>

#include "core/light/light_map.h"

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

}  // namespace refield
