// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstddef>
#include <span>

#include "core/metrics.h"

namespace refield {

/// Peak signal-to-noise ratio in dB of the two pictures as a screen shows them; infinity where they look the
/// same. Both are exposed so that the 99th percentile of `observed` is white (exposure_to_white()), clipped
/// to 0 … 1 and sRGB encoded; the peak is 1. Without that a single highlight sets the peak and hides any
/// error beside it. Samples whose `sigma` is infinite are left out. Throws InputError when the shapes differ.
double tone_mapped_psnr_db(const Image& predicted, const Image& observed, const Mask& mask = {},
                           const Image& sigma = {});

/// The two measures of one image of a series.
struct ImageError {
  double relative_rmse = 0.0;
  double tone_mapped_psnr_db = 0.0;
};
ImageError image_error(const Image& predicted, const Image& observed, const Mask& mask = {},
                       const Image& sigma = {});

/// The tone-mapped PSNR of a series: of the mean of its images' squared errors, each at its own exposure.
double tone_mapped_psnr_db(std::span<const ImageError> images);

/// How the relative RMSE of single images is spread over a series.
struct ErrorSpread {
  double median = 0.0;
  double mean = 0.0;
  double largest = 0.0;
  std::size_t worst = 0;  ///< which image has the largest
};
/// Of at least one image.
ErrorSpread spread_of(std::span<const ImageError> images);

}  // namespace refield
