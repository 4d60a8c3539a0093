// SPDX-License-Identifier: Apache-2.0
#include "core/image/false_colour.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace refield {

namespace {

std::uint8_t level_of_fraction(double fraction) {
  return static_cast<std::uint8_t>(std::lround(255.0 * std::clamp(fraction, 0.0, 1.0)));
}

}  // namespace

EncodedColour false_colour(double fraction) {
  const double position = std::clamp(fraction, 0.0, 1.0) * (false_colour_stops.size() - 1);
  const auto low = std::min(static_cast<std::size_t>(position), false_colour_stops.size() - 2);
  const auto t = static_cast<float>(position - static_cast<double>(low));
  EncodedColour colour;
  for (int c = 0; c < 3; ++c)
    colour[c] = (1.0f - t) * false_colour_stops[low][c] + t * false_colour_stops[low + 1][c];
  return colour;
}

LevelTable linear_levels(double high) {
  if (!(high > 0.0)) throw InputError("false colours need a range above zero");
  return LevelTable([high](float value) { return level_of_fraction(value / high); });
}

LevelTable stop_levels(double low, double high) {
  if (!(high > low)) throw InputError("false colours need a range of stops above zero");
  return LevelTable([=](float value) {
    return value > 0.0f ? level_of_fraction((std::log2(value) - low) / (high - low)) : std::uint8_t{0};
  });
}

void false_colour_rgba(const Image& image, const LevelTable& levels, std::span<std::uint8_t> rgba) {
  if ((image.channels != 1 && image.channels != 3) || rgba.size() != 4 * image.pixel_count())
    throw InputError("an image of " + shape_text(image) + " does not fill " + std::to_string(rgba.size()) +
                     " bytes of RGBA; it needs 1 or 3 channels and 4 bytes per pixel");
  std::array<std::array<std::uint8_t, 4>, 256> colours;
  for (int level = 0; level < 256; ++level) {
    const EncodedColour colour = false_colour(level / 255.0);
    for (int c = 0; c < 3; ++c) colours[level][c] = level_of_fraction(colour[c]);
    colours[level][3] = 255;
  }
  constexpr std::array<std::uint8_t, 4> unknown = {128, 128, 128, 255};
  const auto value_of = [&image](std::size_t p) {
    const float* v = image.values.data() + p * image.channels;
    return image.channels == 1 ? v[0] : 0.2126f * v[0] + 0.7152f * v[1] + 0.0722f * v[2];
  };
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, image.pixel_count(), 8192), [&](const auto& range) {
    for (std::size_t p = range.begin(); p != range.end(); ++p) {
      const float value = value_of(p);
      std::ranges::copy(std::isnan(value) ? unknown : colours[levels(value)], rgba.begin() + 4 * p);
    }
  });
}

}  // namespace refield
