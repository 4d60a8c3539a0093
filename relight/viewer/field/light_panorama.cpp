// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/field/light_panorama.h"

#include <algorithm>
#include <cmath>

#include "core/light/cube_map.h"

namespace refield {

namespace {

constexpr int widest = 1024;  // a screen's panel has no more pixels

std::size_t texel_number(const Point& texel, const LightDomain& domain) {
  const int x = std::clamp(static_cast<int>(texel.x), 0, domain.width - 1),
            y = std::clamp(static_cast<int>(texel.y), 0, domain.height - 1);
  return static_cast<std::size_t>(y) * domain.width + x;
}

}  // namespace

LightPanorama::LightPanorama(const LightDomain& domain) : domain_(domain), shown_(domain) {
  if (domain.parameterisation != Parameterisation::cube) return;
  const int width = std::min(4 * domain.width, widest);
  shown_ = {width, width / 2, Parameterisation::lat_long};
  for (int y = 0; y < shown_.height; ++y)
    for (int x = 0; x < shown_.width; ++x)
      texel_.push_back(static_cast<std::uint32_t>(texel_number(texel_at({x + 0.5, y + 0.5}), domain)));
}

Image LightPanorama::show(const Image& map) const {
  Image image(shown_.width, shown_.height, map.channels);
  const auto channels = static_cast<std::size_t>(map.channels);
  for (std::size_t pixel = 0; pixel < texel_.size(); ++pixel)
    std::copy_n(map.values.begin() + static_cast<std::ptrdiff_t>(texel_[pixel] * channels), channels,
                image.values.begin() + static_cast<std::ptrdiff_t>(pixel * channels));
  return image;
}

Point LightPanorama::texel_at(const Point& shown) const {
  if (domain_.parameterisation != Parameterisation::cube) return shown;
  const Eigen::Vector2d texel =
      cube_position(lat_long_direction(shown.x, shown.y, shown_.width, shown_.height), domain_.width);
  return {texel.x(), texel.y()};
}

}  // namespace refield
