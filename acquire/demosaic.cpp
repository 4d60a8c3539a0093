// SPDX-License-Identifier: Apache-2.0
#include "acquire/demosaic.h"

#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "core/errors.h"

namespace refield {

namespace {

cv::Mat filtered(const cv::Mat& plane, const cv::Mat& kernel) {
  cv::Mat result;
  cv::filter2D(plane, result, CV_32F, kernel, cv::Point(-1, -1), 0.0, cv::BORDER_CONSTANT);
  return result;
}

}  // namespace

Photograph demosaic(const Image& radiance, const Image& sigma, PixelLayout layout) {
  if (!is_bayer(layout) || radiance.channels != 1 || !radiance.same_shape(sigma) || radiance.width < 2 ||
      radiance.height < 2)
    throw InputError("Bayer planes must have one channel and at least 2×2 pixels, not " +
                     shape_text(radiance));
  const int width = radiance.width;
  const int height = radiance.height;
  const cv::Mat red_blue_kernel = (cv::Mat_<float>(3, 3) << 1, 2, 1, 2, 4, 2, 1, 2, 1);
  const cv::Mat green_kernel = (cv::Mat_<float>(3, 3) << 0, 1, 0, 1, 4, 1, 0, 1, 0);
  Photograph rgb{Image(width, height, 3), Image(width, height, 3)};
  for (int c = 0; c < 3; ++c) {
    cv::Mat present(height, width, CV_32F, cv::Scalar(0));
    cv::Mat value = present.clone();
    cv::Mat variance = present.clone();
    cv::Mat clipped = present.clone();
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        if (bayer_channel(layout, x, y) != c) continue;
        const float s = sigma.at(x, y, 0);
        present.at<float>(y, x) = 1.0f;
        value.at<float>(y, x) = radiance.at(x, y, 0);
        variance.at<float>(y, x) = std::isinf(s) ? 0.0f : s * s;
        clipped.at<float>(y, x) = std::isinf(s) ? 1.0f : 0.0f;
      }
    const cv::Mat& kernel = c == 1 ? green_kernel : red_blue_kernel;
    const cv::Mat squared_kernel = kernel.mul(kernel);
    const cv::Mat weight_sum = filtered(present, kernel);
    const cv::Mat value_sum = filtered(value, kernel);
    const cv::Mat variance_sum = filtered(variance, squared_kernel);
    const cv::Mat clipped_sum = filtered(clipped, kernel);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        if (bayer_channel(layout, x, y) ==
            c) {  // a measured sample; for green the kernel would blend nothing in either
          rgb.radiance.at(x, y, c) = radiance.at(x, y, 0);
          rgb.sigma.at(x, y, c) = sigma.at(x, y, 0);
          continue;
        }
        const float weight = weight_sum.at<float>(y, x);
        rgb.radiance.at(x, y, c) = value_sum.at<float>(y, x) / weight;
        rgb.sigma.at(x, y, c) = clipped_sum.at<float>(y, x) > 0.0f
                                    ? std::numeric_limits<float>::infinity()
                                    : std::sqrt(variance_sum.at<float>(y, x)) / weight;
      }
  }
  return rgb;
}

}  // namespace refield
