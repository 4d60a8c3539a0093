// SPDX-License-Identifier: Apache-2.0
#include "core/image.h"

#include <cmath>

#include "core/errors.h"

namespace refield {

Image copied_rows(const ImageView& view, int first, int last) {
  Image copy(view.width, last - first, view.channels);
  for (int y = first; y < last; ++y)
    for (int x = 0; x < view.width; ++x)
      for (int c = 0; c < view.channels; ++c) copy.at(x, y - first, c) = view.at(x, y, c);
  return copy;
}

std::string shape_text(const Image& image) {
  return std::to_string(image.width) + "×" + std::to_string(image.height) + "×" +
         std::to_string(image.channels);
}

void require_finite(const Image& image, const std::string& name, bool allow_negative,
                    const std::string& remedy) {
  for (std::size_t i = 0; i < image.values.size(); ++i) {
    const float value = image.values[i];
    if (std::isfinite(value) && (allow_negative || value >= 0.0f)) continue;
    const std::size_t pixel = i / image.channels;
    throw InputError(name + ": pixel (" + std::to_string(pixel % image.width) + ", " +
                     std::to_string(pixel / image.width) + ") is " + std::to_string(value) + "; " + remedy);
  }
}

}  // namespace refield
