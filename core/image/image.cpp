// SPDX-License-Identifier: Apache-2.0
#include "core/image/image.h"

#include <algorithm>
#include <cmath>

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
    throw InputError(name, ": pixel (", pixel % image.width, ", ", pixel / image.width, ") is ", value, "; ",
                     remedy);
  }
}

namespace {

/// What of each old texel falls into each new one, along one side: [first, first + weights) with sum 1.
struct Span {
  int first = 0;
  std::vector<float> weights;
};

/// `count` new texels over the old ones from `from` to `to`, not necessarily whole.
std::vector<Span> spans(double from, double to, int old_count, int count) {
  std::vector<Span> result(count);
  const double step = (to - from) / count;
  for (int i = 0; i < count; ++i) {
    const double begin = from + i * step, end = begin + step;
    Span& span = result[i];
    span.first = std::clamp(static_cast<int>(std::floor(begin)), 0, old_count - 1);
    const int last = std::clamp(static_cast<int>(std::ceil(end)), span.first + 1, old_count);
    for (int k = span.first; k < last; ++k)
      span.weights.push_back(static_cast<float>(
          std::max(0.0, std::min<double>(end, k + 1) - std::max<double>(begin, k)) / step));
  }
  return result;
}

Image resample(const Image& image, const std::vector<Span>& columns, const std::vector<Span>& rows) {
  Image narrow(static_cast<int>(columns.size()), image.height, image.channels);
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < narrow.width; ++x)
      for (std::size_t k = 0; k < columns[x].weights.size(); ++k)
        for (int c = 0; c < image.channels; ++c)
          narrow.at(x, y, c) +=
              columns[x].weights[k] * image.at(columns[x].first + static_cast<int>(k), y, c);
  Image result(narrow.width, static_cast<int>(rows.size()), image.channels);
  for (int y = 0; y < result.height; ++y)
    for (std::size_t k = 0; k < rows[y].weights.size(); ++k) {
      const auto from = narrow.row(rows[y].first + static_cast<int>(k));
      const auto to = result.row(y);
      for (std::size_t i = 0; i < to.size(); ++i) to[i] += rows[y].weights[k] * from[i];
    }
  return result;
}

void check(const Image& image, int width, int height) {
  if (image.empty() || width < 1 || height < 1)
    throw InputError("cannot resample an image of ", shape_text(image), " to ", width, "×", height,
                     "; sizes must be 1 or more");
}

}  // namespace

Image resample_area(const Image& image, int width, int height) {
  check(image, width, height);
  return resample(image, spans(0, image.width, image.width, width),
                  spans(0, image.height, image.height, height));
}

Image resample_area_cropped(const Image& image, int width, int height) {
  check(image, width, height);
  const double scale =
      std::min(static_cast<double>(image.width) / width, static_cast<double>(image.height) / height);
  const double left = 0.5 * (image.width - scale * width), top = 0.5 * (image.height - scale * height);
  return resample(image, spans(left, left + scale * width, image.width, width),
                  spans(top, top + scale * height, image.height, height));
}

}  // namespace refield
