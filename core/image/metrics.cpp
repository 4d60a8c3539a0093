// SPDX-License-Identifier: Apache-2.0
#include "core/image/metrics.h"

#include <cmath>
#include <limits>
#include <numeric>

#include "core/image/tone_map.h"

namespace refield {

namespace {

double relative(double error, double signal) {
  if (signal > 0.0) return std::sqrt(error / signal);
  return error > 0.0 ? std::numeric_limits<double>::infinity() : 0.0;
}

bool counts(const Mask& mask, std::size_t pixel) {
  return mask.empty() || mask[pixel] != 0;
}

void require_same_shape(const Image& predicted, const Image& observed) {
  if (!predicted.same_shape(observed))
    throw InputError("cannot compare an image of ", shape_text(predicted), " with one of ",
                     shape_text(observed));
}

/// Ranks from 0; equal values share the mean of their places.
std::vector<double> ranks_of(std::span<const float> values) {
  std::vector<std::size_t> order(values.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::sort(order, {}, [&](std::size_t i) { return values[i]; });
  std::vector<double> ranks(values.size());
  for (std::size_t first = 0; first < order.size();) {
    std::size_t last = first + 1;
    while (last < order.size() && values[order[last]] == values[order[first]]) ++last;
    for (std::size_t i = first; i < last; ++i) ranks[order[i]] = 0.5 * static_cast<double>(first + last - 1);
    first = last;
  }
  return ranks;
}

void require_fit(const Mask& mask, const Image& image) {
  if (!mask.empty() && mask.size() != image.pixel_count())
    throw InputError("the mask has ", mask.size(), " pixels, the image ", image.pixel_count());
}

/// Adds Σ(predicted − observed)² and Σ observed² over a pixel's measured samples.
void add_pixel(const Image& predicted, const Image& observed, const Image& sigma, std::size_t pixel,
               double& error, double& signal) {
  const auto channels = static_cast<std::size_t>(observed.channels);
  for (std::size_t i = pixel * channels; i < (pixel + 1) * channels; ++i) {
    if (!sigma.empty() && std::isinf(sigma.values[i])) continue;
    const double p = predicted.values[i];
    const double o = observed.values[i];
    error += (p - o) * (p - o);
    signal += o * o;
  }
}

}  // namespace

void SeriesError::add(const Image& predicted, const Image& observed, const Image& sigma) {
  require_same_shape(predicted, observed);
  if (!sigma.empty()) require_same_shape(observed, sigma);
  if (images_ == 0) {
    require_fit(mask_, observed);
    width_ = observed.width;
    height_ = observed.height;
    error_.assign(observed.pixel_count(), 0.0);
    signal_.assign(observed.pixel_count(), 0.0);
  } else if (observed.width != width_ || observed.height != height_) {
    throw InputError("the images of a series differ in size: ", width_, "×", height_, " and ",
                     shape_text(observed));
  }
  ++images_;
  for (std::size_t pixel = 0; pixel < error_.size(); ++pixel)
    if (counts(mask_, pixel)) add_pixel(predicted, observed, sigma, pixel, error_[pixel], signal_[pixel]);
}

double SeriesError::relative_rmse() const {
  return relative(std::accumulate(error_.begin(), error_.end(), 0.0),
                  std::accumulate(signal_.begin(), signal_.end(), 0.0));
}

Image SeriesError::relative_rmse_map() const {
  if (images_ == 0) return {};
  Image map(width_, height_, 1);
  for (std::size_t pixel = 0; pixel < error_.size(); ++pixel)
    map.values[pixel] = static_cast<float>(relative(error_[pixel], signal_[pixel]));
  return map;
}

double SeriesError::pixel_quantile(double q) const {
  return quantile(values_in_mask(relative_rmse_map(), mask_), q);
}

double relative_rmse(const Image& predicted, const Image& observed, const Mask& mask) {
  SeriesError error(mask);
  error.add(predicted, observed);
  return error.relative_rmse();
}

double quantile(std::vector<float> values, double q) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  const double position = std::clamp(q, 0.0, 1.0) * static_cast<double>(values.size() - 1);
  const auto low = static_cast<std::size_t>(position);
  const double fraction = position - static_cast<double>(low);
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(low);
  std::ranges::nth_element(values, at);
  const float high = at + 1 == values.end() ? *at : *std::min_element(at + 1, values.end());
  return *at * (1.0 - fraction) + high * fraction;
}

double rank_correlation(std::span<const float> a, std::span<const float> b) {
  if (a.size() != b.size()) throw InputError("a rank correlation needs two series of one length");
  const std::vector<double> ranks_a = ranks_of(a);
  const std::vector<double> ranks_b = ranks_of(b);
  const double mean = 0.5 * (static_cast<double>(a.size()) - 1.0);
  double ab = 0.0, aa = 0.0, bb = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    ab += (ranks_a[i] - mean) * (ranks_b[i] - mean);
    aa += (ranks_a[i] - mean) * (ranks_a[i] - mean);
    bb += (ranks_b[i] - mean) * (ranks_b[i] - mean);
  }
  return aa > 0.0 && bb > 0.0 ? ab / std::sqrt(aa * bb) : std::numeric_limits<double>::quiet_NaN();
}

std::vector<float> values_in_mask(const Image& map, const Mask& mask) {
  std::vector<float> values;
  for (std::size_t p = 0; p < map.pixel_count(); ++p)
    if (counts(mask, p)) values.push_back(map.values[p]);
  return values;
}

namespace {

/// Of a mean squared error; the peak is 1.
double psnr_db(double error) {
  return error > 0.0 ? -10.0 * std::log10(error) : std::numeric_limits<double>::infinity();
}

}  // namespace

double tone_mapped_psnr_db(const Image& predicted, const Image& observed, const Mask& mask,
                           const Image& sigma) {
  if (!predicted.same_shape(observed) || (!sigma.empty() && !sigma.same_shape(observed)))
    throw InputError("cannot compare an image of ", shape_text(predicted), " with one of ",
                     shape_text(observed));
  const auto exposure = static_cast<float>(exposure_to_white(observed, mask));
  const auto shown = [&](float value) { return srgb_from_linear(std::clamp(value * exposure, 0.0f, 1.0f)); };
  const auto channels = static_cast<std::size_t>(observed.channels);
  double error = 0.0;
  std::size_t samples = 0;
  for (std::size_t i = 0; i < observed.values.size(); ++i) {
    if ((!mask.empty() && mask[i / channels] == 0) || (!sigma.empty() && std::isinf(sigma.values[i])))
      continue;
    const double difference = static_cast<double>(shown(predicted.values[i])) - shown(observed.values[i]);
    error += difference * difference;
    ++samples;
  }
  return psnr_db(samples > 0 ? error / static_cast<double>(samples) : 0.0);
}

ImageError image_error(const Image& predicted, const Image& observed, const Mask& mask, const Image& sigma) {
  require_fit(mask, observed);
  const double psnr_db = tone_mapped_psnr_db(predicted, observed, mask, sigma);  // checks the shapes
  double error = 0.0, signal = 0.0;
  for (std::size_t pixel = 0; pixel < observed.pixel_count(); ++pixel) {
    if (!counts(mask, pixel)) continue;
    double of_pixel = 0.0, signal_of_pixel = 0.0;  // in the order of SeriesError's sums
    add_pixel(predicted, observed, sigma, pixel, of_pixel, signal_of_pixel);
    error += of_pixel;
    signal += signal_of_pixel;
  }
  return {relative(error, signal), psnr_db};
}

double tone_mapped_psnr_db(std::span<const ImageError> images) {
  double error = 0.0;
  for (const ImageError& image : images) error += std::pow(10.0, -0.1 * image.tone_mapped_psnr_db);
  return psnr_db(images.empty() ? 0.0 : error / static_cast<double>(images.size()));
}

ErrorSpread spread_of(std::span<const ImageError> images) {
  ErrorSpread spread;
  std::vector<float> errors;
  for (std::size_t i = 0; i < images.size(); ++i) {
    const double error = images[i].relative_rmse;
    errors.push_back(static_cast<float>(error));
    spread.mean += error / static_cast<double>(images.size());
    if (i == 0 || error > spread.largest) {
      spread.largest = error;
      spread.worst = i;
    }
  }
  spread.median = quantile(std::move(errors), 0.5);
  return spread;
}

}  // namespace refield
