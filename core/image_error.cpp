// SPDX-License-Identifier: Apache-2.0
#include "core/image_error.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "core/auto_exposure.h"
#include "core/errors.h"
#include "core/tone_map.h"

namespace refield {

namespace {

/// Of a mean squared error; the peak is 1.
double psnr_db(double error) {
  return error > 0.0 ? -10.0 * std::log10(error) : std::numeric_limits<double>::infinity();
}

}  // namespace

double tone_mapped_psnr_db(const Image& predicted, const Image& observed, const Mask& mask,
                           const Image& sigma) {
  if (!predicted.same_shape(observed) || (!sigma.empty() && !sigma.same_shape(observed)))
    throw InputError("cannot compare an image of " + shape_text(predicted) + " with one of " +
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
  SeriesError error(mask);
  error.add(predicted, observed, sigma);
  return {error.relative_rmse(), tone_mapped_psnr_db(predicted, observed, mask, sigma)};
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
