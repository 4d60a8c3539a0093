// SPDX-License-Identifier: Apache-2.0
#include "core/field/reflectance_field.h"

#include <algorithm>

namespace refield {

double FieldOutline::unobserved_share(const Image& radiance) const {
  if (observed_light.empty()) return 0.0;
  double all = 0.0, observed = 0.0;
  for (const float value : radiance.values) all += value;
  for (const Box& box : observed_light)
    for (int y = box.y0; y < box.y1; ++y)
      for (int x = box.x0; x < box.x1; ++x)
        for (int c = 0; c < radiance.channels; ++c) observed += radiance.at(x, y, c);
  return all > 0.0 ? std::clamp(1.0 - observed / all, 0.0, 1.0) : 0.0;
}

Image ReflectanceField::relight(const LightMap& light) const {
  Image image(width, height, 3);
  transfer.apply(basis.project(light), image.values);
  return image;
}

}  // namespace refield
