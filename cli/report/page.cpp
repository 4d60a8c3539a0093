// SPDX-License-Identifier: Apache-2.0
#include "cli/report/page.h"

#include <cmath>

#include "core/base/number_text.h"
#include "core/image/image_io.h"
#include "core/image/tone_map.h"

namespace refield::report {

namespace page_template {
extern const std::string_view before_data, after_data;  // made from page.html and what it holds by CMake
}

std::string page_html(const Json& data) {
  std::string text = json_text(data);
  // Text in the data must not end the script that holds them.
  for (auto at = text.find('<'); at != std::string::npos; at = text.find('<', at))
    text.replace(at, 1, "\\u003c");
  return std::string(page_template::before_data) + text + std::string(page_template::after_data);
}

std::string base64(std::span<const std::uint8_t> bytes) {
  static constexpr char alphabet[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t left = std::min<std::size_t>(3, bytes.size() - i);
    std::uint32_t group = 0;
    for (std::size_t k = 0; k < 3; ++k) group = group << 8 | (k < left ? bytes[i + k] : 0u);
    for (std::size_t k = 0; k < 4; ++k) text += k <= left ? alphabet[group >> (18 - 6 * k) & 63] : '=';
  }
  return text;
}

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

std::string significant(double value, int digits) {
  if (!std::isfinite(value)) return "–";
  if (value == 0.0) return "0";
  // Round first: 9.996 to three digits is 10.0, which has a decimal less.
  value = *number_from_text<double>(formatted("%.*e", digits - 1, value));
  const int magnitude = static_cast<int>(std::floor(std::log10(std::abs(value)) + 1e-9));
  return formatted("%.*f", std::max(0, digits - 1 - magnitude), value);
}

std::string bytes_text(double bytes) {
  static constexpr std::array units = {"bytes", "kB", "MB", "GB", "TB"};
  std::size_t unit = 0;
  for (; bytes >= 999.5 && unit + 1 < units.size(); ++unit) bytes /= 1000.0;
  return (unit == 0 ? formatted("%.0f", bytes) : significant(bytes, 3)) + " " + units[unit];
}

double round_up(double value) {
  const double decade = std::pow(10.0, std::floor(std::log10(value)));
  for (const double multiple : {1.0, 2.0, 2.5, 5.0, 10.0})
    if (multiple * decade >= value * (1.0 - 1e-9)) return multiple * decade;
  return 10.0 * decade;
}

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
  return number_from_text<double>(significant(exact, 2)).value_or(exact);
}

Image error_magnitude(const Image& predicted, const Image& reference) {
  if (!predicted.same_shape(reference))
    throw InputError("cannot compare an image of ", shape_text(predicted), " with one of ",
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

Json picture_json(const Image& image, double exposure) {
  return {{"width", image.width},
          {"height", image.height},
          {"png", "data:image/png;base64," + base64(encode_png(image, {exposure}))}};
}

}  // namespace refield::report
