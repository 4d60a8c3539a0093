// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <vector>

#include "core/image/image.h"
#include "core/light/light_map.h"
#include "relight/viewer/gui/canvas.h"

namespace refield {

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

}  // namespace refield
