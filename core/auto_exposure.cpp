// SPDX-License-Identifier: Apache-2.0
#include "core/auto_exposure.h"

#include <algorithm>
#include <cmath>

namespace refield {

double exposure_to_white(const Image& image, const Mask& mask) {
  Image brightest(image.width, image.height, 1);
  for (std::size_t p = 0; p < brightest.pixel_count(); ++p)
    for (int c = 0; c < image.channels; ++c)
      brightest.values[p] = std::max(brightest.values[p], image.values[p * image.channels + c]);
  const double white = quantile(values_in_mask(brightest, mask), 0.99);
  return white > 0.0 && std::isfinite(white) ? 1.0 / white : 1.0;
}

}  // namespace refield
