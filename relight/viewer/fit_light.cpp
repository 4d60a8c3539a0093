// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/fit_light.h"

#include <cmath>

#include "core/errors.h"
#include "core/resample.h"

namespace refield {

namespace {

std::string size_text(int width, int height) {
  return std::to_string(width) + "×" + std::to_string(height);
}

bool has_proportions(const Image& image, double width, double height) {
  constexpr double tolerance = 0.01;  // sizes are whole numbers of texels
  return std::abs(image.width * height / (image.height * width) - 1.0) < tolerance;
}

void require_proportions(const Image& image, const LightDomain& domain) {
  const std::string given = "the map is " + size_text(image.width, image.height);
  if (domain.parameterisation == Parameterisation::cube && !has_proportions(image, 1.0, 6.0))
    throw InputError(given + ", the field expects a cube map: six square faces from top to bottom (1:6)");
  if (domain.parameterisation == Parameterisation::lat_long && !has_proportions(image, 2.0, 1.0) &&
      !has_proportions(image, domain.width, domain.height))
    throw InputError(given + ", the field expects a lat-long map, which is twice as wide as high");
}

}  // namespace

FittedLight fit_light(const Image& image, const LightDomain& domain) {
  const Parameterisation kind = domain.parameterisation;
  if (image.width == domain.width && image.height == domain.height) return {{image, kind}, ""};
  require_proportions(image, domain);
  const std::string note =
      size_text(image.width, image.height) + " to " + size_text(domain.width, domain.height) + ", by area";
  if (kind != Parameterisation::monitor || has_proportions(image, domain.width, domain.height))
    return {{resample_area(image, domain.width, domain.height), kind}, note};
  const bool is_wider =
      static_cast<double>(image.width) * domain.height > static_cast<double>(image.height) * domain.width;
  return {{resample_area_cropped(image, domain.width, domain.height), kind},
          note + (is_wider ? ", sides cropped" : ", top and bottom cropped")};
}

}  // namespace refield
