// SPDX-License-Identifier: Apache-2.0
#include "cli/report/picture.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>

#include "cli/report/html.h"
#include "core/base/errors.h"
#include "core/image/false_colour.h"
#include "core/image/image_io.h"
#include "core/image/tone_map.h"

namespace refield::report {

namespace {

constexpr float outside_grey = 0.5f;

template <class Merge, class Finish>
Image merged_blocks(const Image& image, int max_width, float start, Merge merge, Finish finish) {
  const int k = (image.width + max_width - 1) / max_width;
  if (k <= 1) return image;
  Image small((image.width + k - 1) / k, (image.height + k - 1) / k, image.channels);
  for (int y = 0; y < small.height; ++y)
    for (int x = 0; x < small.width; ++x)
      for (int c = 0; c < image.channels; ++c) {
        const int x1 = std::min(image.width, (x + 1) * k), y1 = std::min(image.height, (y + 1) * k);
        float value = start;
        for (int v = y * k; v < y1; ++v)
          for (int u = x * k; u < x1; ++u) value = merge(value, image.at(u, v, c));
        small.at(x, y, c) = finish(value, (x1 - x * k) * (y1 - y * k));
      }
  return small;
}

}  // namespace

Image shrunk(const Image& image, int max_width) {
  return merged_blocks(
      image, max_width, 0.0f, [](float a, float b) { return a + b; },
      [](float sum, int count) { return sum / static_cast<float>(count); });
}

Image shrunk_by_maximum(const Image& image, int max_width) {
  return merged_blocks(
      image, max_width, -std::numeric_limits<float>::infinity(),
      [](float a, float b) { return std::max(a, b); }, [](float highest, int) { return highest; });
}

double display_exposure(const Image& image, const Mask& mask) {
  const double exact = exposure_to_white(image, mask);
  const std::string text = significant(exact, 2);
  double exposure = exact;
  std::from_chars(text.data(), text.data() + text.size(), exposure);
  return exposure;
}

Image error_magnitude(const Image& predicted, const Image& reference) {
  if (!predicted.same_shape(reference))
    throw InputError("cannot compare an image of " + shape_text(predicted) + " with one of " +
                     shape_text(reference));
  Image magnitude(predicted.width, predicted.height, 1);
  for (std::size_t p = 0; p < magnitude.pixel_count(); ++p) {
    double sum = 0.0;
    for (int c = 0; c < predicted.channels; ++c) {
      const double d =
          predicted.values[p * predicted.channels + c] - reference.values[p * predicted.channels + c];
      sum += d * d;
    }
    magnitude.values[p] = static_cast<float>(std::sqrt(sum / predicted.channels));
  }
  return magnitude;
}

Image false_coloured(const Image& map, double high, const Mask& mask) {
  Image coloured(map.width, map.height, 3);
  for (std::size_t p = 0; p < map.pixel_count(); ++p) {
    const bool inside = mask.empty() || mask[p] != 0;
    const double value = map.values[p];
    const EncodedColour colour = inside ? false_colour(std::isnan(value) ? 1.0 : value / high)
                                        : EncodedColour{outside_grey, outside_grey, outside_grey};
    for (int c = 0; c < 3; ++c) coloured.values[3 * p + c] = linear_from_srgb(colour[c]);
  }
  return coloured;
}

std::string colour_bar_html(const std::string& low_text, const std::string& high_text) {
  std::string stops;
  for (const EncodedColour& stop : false_colour_stops) {
    stops += ",rgb(";
    for (int c = 0; c < 3; ++c)
      stops.append(std::to_string(std::lround(255.0f * stop[c]))).append(c < 2 ? "," : ")");
  }
  return "<span class=\"colour-bar\"><span>" + escaped(low_text) +
         "</span><i style=\"background:linear-gradient(to right" + stops + ")\"></i><span>" +
         escaped(high_text) + "</span></span>";
}

std::string png_address(const Image& image, double exposure) {
  return "data:image/png;base64," + base64(encode_png(image, {exposure}));
}

std::string image_html(const Image& image, double exposure, const std::string& alt, const std::string& css) {
  return "<img class=\"" + css + "\" width=\"" + std::to_string(image.width) + "\" height=\"" +
         std::to_string(image.height) + "\" alt=\"" + escaped(alt) + "\" src=\"" +
         png_address(image, exposure) + "\">";
}

}  // namespace refield::report
