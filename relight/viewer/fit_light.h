// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>

#include "core/light_map.h"

namespace refield {

/// A light map brought to a field's size.
struct FittedLight {
  LightMap light;
  std::string note;  ///< what was done to it: "1024×512 to 800×600, by area, sides cropped"; empty: nothing
};

/// Brings `image` to `domain`'s size, by area, so that no light is lost and small suns stay as bright in all.
/// A monitor shows the middle of a map of other proportions. A lat-long or cube map must have proportions of
/// its kind (2:1 or the field's own, 1:6); throws InputError otherwise.
FittedLight fit_light(const Image& image, const LightDomain& domain);

}  // namespace refield
