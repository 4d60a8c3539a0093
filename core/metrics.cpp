// SPDX-License-Identifier: Apache-2.0
#include "core/metrics.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/errors.h"

namespace refield {

namespace {

struct SquaredSums {
  double error = 0.0;
  double signal = 0.0;
  std::size_t samples = 0;
};

void require_comparable(std::span<const Image> predicted, std::span<const Image> observed, const Mask& mask) {
  if (predicted.size() != observed.size())
    throw InputError("cannot compare " + std::to_string(predicted.size()) + " images with " +
                     std::to_string(observed.size()));
  for (std::size_t i = 0; i < predicted.size(); ++i) {
    if (!predicted[i].same_shape(observed[i]))
      throw InputError("cannot compare an image of " + shape_text(predicted[i]) + " with one of " +
                       shape_text(observed[i]));
    if (!mask.empty() && mask.size() != predicted[i].pixel_count())
      throw InputError("the mask has " + std::to_string(mask.size()) + " pixels, the image " +
                       std::to_string(predicted[i].pixel_count()));
  }
}

void add_pixel(SquaredSums& sums, const Image& predicted, const Image& observed, std::size_t pixel) {
  for (int c = 0; c < predicted.channels; ++c) {
    const double p = predicted.values[pixel * predicted.channels + c];
    const double o = observed.values[pixel * predicted.channels + c];
    sums.error += (p - o) * (p - o);
    sums.signal += o * o;
    ++sums.samples;
  }
}

double relative(const SquaredSums& sums) {
  if (sums.signal > 0.0) return std::sqrt(sums.error / sums.signal);
  return sums.error > 0.0 ? std::numeric_limits<double>::infinity() : 0.0;
}

bool counts(const Mask& mask, std::size_t pixel) { return mask.empty() || mask[pixel] != 0; }

SquaredSums sum_over(std::span<const Image> predicted, std::span<const Image> observed, const Mask& mask) {
  require_comparable(predicted, observed, mask);
  SquaredSums sums;
  for (std::size_t i = 0; i < predicted.size(); ++i)
    for (std::size_t p = 0; p < predicted[i].pixel_count(); ++p)
      if (counts(mask, p)) add_pixel(sums, predicted[i], observed[i], p);
  return sums;
}

}  // namespace

double relative_rmse(std::span<const Image> predicted, std::span<const Image> observed, const Mask& mask) {
  return relative(sum_over(predicted, observed, mask));
}

double relative_rmse(const Image& predicted, const Image& observed, const Mask& mask) {
  return relative_rmse(std::span(&predicted, 1), std::span(&observed, 1), mask);
}

Image relative_rmse_map(std::span<const Image> predicted, std::span<const Image> observed, const Mask& mask) {
  require_comparable(predicted, observed, mask);
  if (predicted.empty()) return {};
  Image map(predicted[0].width, predicted[0].height, 1);
  for (std::size_t p = 0; p < map.pixel_count(); ++p) {
    if (!counts(mask, p)) continue;
    SquaredSums sums;
    for (std::size_t i = 0; i < predicted.size(); ++i) add_pixel(sums, predicted[i], observed[i], p);
    map.values[p] = static_cast<float>(relative(sums));
  }
  return map;
}

double psnr_db(const Image& predicted, const Image& observed, const Mask& mask) {
  const SquaredSums sums = sum_over(std::span(&predicted, 1), std::span(&observed, 1), mask);
  double peak = 0.0;
  for (std::size_t p = 0; p < observed.pixel_count(); ++p)
    for (int c = 0; c < observed.channels; ++c)
      if (counts(mask, p)) peak = std::max<double>(peak, observed.values[p * observed.channels + c]);
  if (sums.error == 0.0) return std::numeric_limits<double>::infinity();
  return 10.0 * std::log10(peak * peak * static_cast<double>(sums.samples) / sums.error);
}

Image absolute_error(const Image& predicted, const Image& observed) {
  require_comparable(std::span(&predicted, 1), std::span(&observed, 1), {});
  Image error(predicted.width, predicted.height, predicted.channels);
  std::ranges::transform(predicted.values, observed.values, error.values.begin(),
                         [](float p, float o) { return std::abs(p - o); });
  return error;
}

double quantile(std::vector<float> values, double q) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  std::ranges::sort(values);
  const double position = std::clamp(q, 0.0, 1.0) * static_cast<double>(values.size() - 1);
  const auto low = static_cast<std::size_t>(position);
  const std::size_t high = std::min(low + 1, values.size() - 1);
  const double fraction = position - static_cast<double>(low);
  return values[low] * (1.0 - fraction) + values[high] * fraction;
}

std::vector<float> values_in_mask(const Image& map, const Mask& mask) {
  std::vector<float> values;
  for (std::size_t p = 0; p < map.pixel_count(); ++p)
    if (counts(mask, p)) values.push_back(map.values[p]);
  return values;
}

}  // namespace refield
