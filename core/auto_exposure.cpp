// SPDX-License-Identifier: Apache-2.0
#include "core/auto_exposure.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "core/tone_map.h"

namespace refield {

namespace {

constexpr double white_quantile = 0.99;

float brightest_channel(const Image& image, std::size_t pixel) {
  float brightest = 0.0f;
  for (int c = 0; c < image.channels; ++c)
    brightest = std::max(brightest, image.values[pixel * image.channels + c]);
  return brightest;
}

/// The largest number of three decimal digits that is not above `value`.
double rounded_down(double value) {
  const double digit = std::pow(10.0, std::floor(std::log10(value)) - 2.0);
  char text[32];
  std::snprintf(text, sizeof text, "%.3g", digit * std::floor(value / digit));
  return std::strtod(text, nullptr);
}

}  // namespace

double exposure_to_white(const Image& image, const Mask& mask) {
  ExposureMeter meter;
  meter.add(image, mask);
  return meter.exposure_to_white();
}

void ExposureMeter::add(const Image& image, const Mask& mask) {
  for (std::size_t p = 0; p < image.pixel_count(); ++p) {
    if (!mask.empty() && mask[p] == 0) continue;
    const float brightest = brightest_channel(image, p);
    if (brightest > 0.0f && std::isfinite(brightest)) brightest_.push_back(brightest);
  }
}

double ExposureMeter::exposure_to_white() {
  if (brightest_.empty()) return 1.0;
  // Fewer than one pixel in a hundred is brighter, however few there are.
  const auto place =
      static_cast<std::size_t>(std::ceil(white_quantile * static_cast<double>(brightest_.size())));
  const auto white = brightest_.begin() + static_cast<std::ptrdiff_t>(std::min(place, brightest_.size() - 1));
  std::nth_element(brightest_.begin(), white, brightest_.end());
  return 1.0 / static_cast<double>(*white);
}

double ExposureMeter::exposure() {
  // The highest level begins at a linear value of 0.9957. The rest of the margin keeps the share below 1 %
  // even where pixels of level 0 are not counted.
  return rounded_down(0.98 * exposure_to_white());
}

double clipped_share(const Image& image, double exposure) {
  const float white = linear_from_srgb(254.5f / 255.0f);
  std::size_t lit = 0, clipped = 0;
  for (std::size_t p = 0; p < image.pixel_count(); ++p) {
    const float brightest = brightest_channel(image, p);
    if (!(brightest > 0.0f)) continue;
    ++lit;
    if (brightest * exposure >= white) ++clipped;
  }
  return lit == 0 ? 0.0 : static_cast<double>(clipped) / static_cast<double>(lit);
}

}  // namespace refield
