// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <vector>

#include "core/box.h"
#include "core/image.h"
#include "core/reflectance_field.h"

namespace refield {

/// One entry of a pixel's row of the transfer.
struct PixelKernel {
  std::uint32_t kernel = 0;  ///< of the basis
  bool is_hat = false;
  Box support;
  std::array<float, 3> weight{};  ///< multiplies the sum of texel values under the kernel
  double energy_share = 0.0;      ///< of the pixel's energy (weight × area, all channels), 0 to 1
};

/// What a pixel takes light from, most energy first. `pixel` counts row-major. Throws InputError for a pixel
/// that the field does not have.
std::vector<PixelKernel> kernels_of_pixel(const ReflectanceField& field, std::size_t pixel);

/// The reflectance function that the kernels add up to: at each texel the sum of the weights (mean of the
/// channels) of the kernels over it, [height × width × 1] of the light map.
Image kernel_density(const ReflectanceField& field, std::size_t pixel);

}  // namespace refield
