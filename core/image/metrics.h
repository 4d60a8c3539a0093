// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <algorithm>

#include "core/image/image.h"

namespace refield {

/// The sums behind the measures below, gathered image by image, so that a long series is never held in
/// memory.
class SeriesError {
 public:
  /// Only pixels of `mask` count; an empty one means all.
  explicit SeriesError(Mask mask = {}) : mask_(std::move(mask)) {}

  /// Adds a pair of images. Samples whose `sigma` is infinite were not measured and are left out; an empty
  /// sigma leaves none out. Throws InputError when shapes differ from each other or from the images before.
  void add(const Image& predicted, const Image& observed, const Image& sigma = {});

  std::size_t images() const { return images_; }
  /// As the function below, over all images; or of each pixel, [height × width × 1], 0 outside the mask.
  double relative_rmse() const;
  Image relative_rmse_map() const;
  /// The q-quantile of relative_rmse_map() inside the mask.
  double pixel_quantile(double q) const;

 private:
  Mask mask_;
  int width_ = 0;
  int height_ = 0;
  std::size_t images_ = 0;
  std::vector<double> error_;   // [pixels], Σ(predicted − observed)²
  std::vector<double> signal_;  // [pixels], Σ observed²
};

/// sqrt(Σ(predicted − observed)² / Σ observed²) over pixels of the mask and channels, unitless.
/// Zero observed and zero predicted give 0; zero observed with any prediction gives infinity.
/// Throws InputError when the shapes differ.
double relative_rmse(const Image& predicted, const Image& observed, const Mask& mask = {});

/// The q-quantile, 0 ≤ q ≤ 1, by linear interpolation between order statistics. NaN for no values.
double quantile(std::vector<float> values, double q);

/// The median; of an even number of values the larger of the middle two, of none 0.
template <class Value>
Value upper_median(std::vector<Value> values) {
  if (values.empty()) return Value{};
  const auto middle = values.begin() + std::ssize(values) / 2;
  std::ranges::nth_element(values, middle);
  return *middle;
}

/// Spearman's rank correlation, −1 to 1; equal values share their mean rank. NaN for fewer than two pairs or
/// where one side is constant. Throws InputError when the lengths differ.
double rank_correlation(std::span<const float> a, std::span<const float> b);

/// The values of a one-channel map inside the mask.
std::vector<float> values_in_mask(const Image& map, const Mask& mask);

/// Peak signal-to-noise ratio in dB of the two pictures as a screen shows them; infinity where they look the
/// same. Both are exposed so that the 99th percentile of `observed` is white (exposure_to_white()), clipped
/// to 0 … 1 and sRGB encoded; the peak is 1. Without that a single highlight sets the peak and hides any
/// error beside it. Samples whose `sigma` is infinite are left out. Throws InputError when the shapes differ.
double tone_mapped_psnr_db(const Image& predicted, const Image& observed, const Mask& mask = {},
                           const Image& sigma = {});

/// The two measures of one image of a series.
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
