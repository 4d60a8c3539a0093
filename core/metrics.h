// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>
#include <vector>

#include "core/image.h"

namespace refield {

/// Which pixels count: [pixels], non-zero where the scene is of interest. Empty: all.
using Mask = std::vector<unsigned char>;

/// sqrt(Σ(predicted − observed)² / Σ observed²) over all images, pixels of the mask and channels, unitless.
/// Zero observed and zero predicted give 0; zero observed with any prediction gives infinity.
/// Throws InputError when the shapes differ.
double relative_rmse(std::span<const Image> predicted, std::span<const Image> observed, const Mask& mask = {});
double relative_rmse(const Image& predicted, const Image& observed, const Mask& mask = {});

/// The same for each pixel over the images and channels, [height × width × 1]. Pixels outside the mask are 0.
Image relative_rmse_map(std::span<const Image> predicted, std::span<const Image> observed, const Mask& mask = {});

/// Peak signal-to-noise ratio in dB with the observed maximum as the peak; infinity for equal images.
double psnr_db(const Image& predicted, const Image& observed, const Mask& mask = {});

/// |predicted − observed|, channel by channel.
Image absolute_error(const Image& predicted, const Image& observed);

/// The q-quantile, 0 ≤ q ≤ 1, by linear interpolation between order statistics. NaN for no values.
double quantile(std::vector<float> values, double q);

/// The values of a one-channel map inside the mask.
std::vector<float> values_in_mask(const Image& map, const Mask& mask);

}  // namespace refield
