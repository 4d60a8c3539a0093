// SPDX-License-Identifier: Apache-2.0
#include "acquire/import/flat_field.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "acquire/calibrate/calibration.h"
#include "core/base/errors.h"
#include "core/base/number_text.h"

namespace refield {

namespace {

/// Share of pixels that may be hot, dusty or outside the card.
constexpr double negligible_share = 0.001;
/// Below this part of its 90th percentile, a pixel shows no card.
constexpr double least_part = 0.05;

[[noreturn]] void refuse_card(const char* what, double share, const char* remedy) {
  throw InputError(
      formatted("the white card is %s in %.1f %% of the pixels; %s", what, 100.0 * share, remedy));
}

/// One channel of the card where `weight` is not zero, smooth: 24 × 18 nodes follow the fall-off of a light
/// source at the distance of the picture's width within 0.1 %.
Image smoothed(const Image& card, const Image& weight, int channel) {
  constexpr int columns = 24, rows = 18;
  Image values(card.width, card.height, 1);
  for (std::size_t p = 0; p < values.values.size(); ++p)
    values.values[p] = card.values[3 * p + static_cast<std::size_t>(channel)];
  const RelativeMap map = fit_relative_map(values, weight, columns, rows);
  double product = 0.0, square = 0.0;
  Image result(card.width, card.height, 1);
  for (int y = 0; y < card.height; ++y)
    for (int x = 0; x < card.width; ++x) {
      const double relative = map.at_pixel(x, y, values);
      result.at(x, y, 0) = static_cast<float>(relative);
      product += weight.at(x, y, 0) * relative * values.at(x, y, 0);
      square += weight.at(x, y, 0) * relative * relative;
    }
  for (float& value : result.values) value *= static_cast<float>(product / square);
  return result;
}

}  // namespace

void divide_by_card(Photograph& photograph, const Photograph& card, double cos_angle, const Mask& mask) {
  const Image& white = card.radiance;
  if (!white.same_shape(photograph.radiance))
    throw InputError("is " + shape_text(white) + ", the photographs are " + shape_text(photograph.radiance) +
                     "; photograph the white card with the same camera");
  constexpr double grazing = 0.05;  // 87°
  if (!(cos_angle > grazing))
    throw InputError(
        "the light source is not in front of the white card, which faces the camera; leave its photograph "
        "out, or import without flat fields");
  std::vector<float> levels(white.pixel_count());
  for (std::size_t p = 0; p < levels.size(); ++p)
    levels[p] = std::min({white.values[3 * p], white.values[3 * p + 1], white.values[3 * p + 2]});
  const auto least = static_cast<float>(least_part * quantile(levels, 0.9));
  Image weight(white.width, white.height, 1);
  std::size_t inside = 0, dark = 0, clipped = 0;
  for (std::size_t p = 0; p < levels.size(); ++p) {
    const bool is_inside = mask.empty() || mask[p] != 0;
    const bool is_dark = !(levels[p] > std::max(least, 0.0f));
    bool is_clipped = false;
    for (std::size_t c = 0; c < 3; ++c)
      is_clipped |= !card.sigma.empty() && std::isinf(card.sigma.values[3 * p + c]);
    inside += is_inside ? 1 : 0;
    dark += is_inside && is_dark ? 1 : 0;
    clipped += is_inside && is_clipped ? 1 : 0;
    weight.values[p] = is_inside && !is_dark && !is_clipped ? 1.0f : 0.0f;
  }
  const auto share = [&](std::size_t count) {
    return static_cast<double>(count) / static_cast<double>(std::max<std::size_t>(inside, 1));
  };
  if (share(clipped) > negligible_share)
    refuse_card("clipped", share(clipped), "expose it shorter, or bracket it (--bracket-size)");
  if (share(dark) > negligible_share)
    refuse_card("dark", share(dark),
                "it must cover the scene and face the camera; use a larger card, or give --mask");
  for (int c = 0; c < 3; ++c) {
    const Image level = smoothed(white, weight, c);
    for (std::size_t p = 0; p < level.values.size(); ++p) {
      const std::size_t sample = 3 * p + static_cast<std::size_t>(c);
      const bool is_inside = mask.empty() || mask[p] != 0;
      const auto factor = static_cast<float>(cos_angle / (is_inside ? level.values[p] : 1.0f));
      photograph.radiance.values[sample] *= factor;
      if (photograph.sigma.empty()) continue;
      float& sigma = photograph.sigma.values[sample];
      sigma = is_inside ? sigma * factor : std::numeric_limits<float>::infinity();
    }
  }
}

}  // namespace refield
