// SPDX-License-Identifier: Apache-2.0
#include "core/field/reflectance_field.h"

namespace refield {

Image ReflectanceField::relight(const LightMap& light) const {
  Image image(width, height, 3);
  transfer.apply(basis.project(light), image.values);
  return image;
}

}  // namespace refield
