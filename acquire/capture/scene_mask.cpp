// SPDX-License-Identifier: Apache-2.0
#include "acquire/capture/scene_mask.h"

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "core/image/image_io.h"

namespace refield {

namespace {

constexpr double noise_multiple = 5.0;   // a response must exceed this many standard deviations
constexpr double least_response = 0.01;  // and this fraction of the brightest (99th percentile) response
constexpr int cleaned_px = 3;            // specks and holes up to about this size go

/// What the pixels differ by and how sure that is, [pixels × 3]. Clipped samples get an infinite difference.
Photograph difference(const Photograph& white, const Photograph* background) {
  Photograph result = white;
  if (result.sigma.empty()) result.sigma = Image(white.radiance.width, white.radiance.height, 3);
  for (std::size_t i = 0; i < result.radiance.values.size(); ++i) {
    float& value = result.radiance.values[i];
    float& sigma = result.sigma.values[i];
    const bool clipped = std::isinf(sigma);
    if (background) {
      value -= background->radiance.values[i];
      if (!background->sigma.empty()) sigma = std::hypot(sigma, background->sigma.values[i]);
      // Clipped with and without the objects: nothing is known, so nothing is claimed.
      if (std::isinf(sigma)) value = clipped && std::isinf(background->sigma.values[i]) ? 0.0f : INFINITY;
    } else if (clipped) {
      value = INFINITY;
    }
    if (std::isinf(sigma)) sigma = 0.0f;
    value = std::abs(value);
  }
  return result;
}

}  // namespace

Mask scene_mask(const Photograph& white, const Photograph* background) {
  if (background && !background->radiance.same_shape(white.radiance))
    throw InputError("the background is ", shape_text(background->radiance), ", the photograph under white ",
                     shape_text(white.radiance), "; take both with one camera");
  const Photograph response = difference(white, background);
  const int width = white.radiance.width;
  const int height = white.radiance.height;
  std::vector<float> measured;
  for (std::size_t i = 0; i < white.radiance.values.size(); ++i)
    if (std::isfinite(white.radiance.values[i])) measured.push_back(white.radiance.values[i]);
  const double brightest = quantile(std::move(measured), 0.99);
  const double least = least_response * std::max(brightest, 0.0);

  cv::Mat mask(height, width, CV_8U, cv::Scalar(0));
  for (std::size_t i = 0; i < response.radiance.values.size(); ++i)
    if (response.radiance.values[i] > least &&
        response.radiance.values[i] > noise_multiple * response.sigma.values[i])
      mask.data[i / 3] = 1;
  const cv::Mat disc = cv::getStructuringElement(cv::MORPH_ELLIPSE, {cleaned_px, cleaned_px});
  cv::morphologyEx(mask, mask, cv::MORPH_OPEN, disc);
  cv::morphologyEx(mask, mask, cv::MORPH_CLOSE, disc);
  if (cv::countNonZero(mask) == 0)
    throw InputError(
        "no pixel responds to the monitor's white: the automatic mask would be empty; check the aim and "
        "exposures, or paint a mask (--mask)");
  return Mask(mask.data, mask.data + mask.total());
}

void write_mask(const fs::path& path, const Mask& mask, int width, int height) {
  Image image(width, height, 1);
  if (mask.size() != image.pixel_count()) throw InputError("the mask does not have the image's size");
  std::ranges::transform(mask, image.values.begin(), [](unsigned char m) { return m ? 1.0f : 0.0f; });
  write_png(path, image);
}

}  // namespace refield
