// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "core/box.h"
#include "core/image.h"
#include "core/reflectance_field.h"
#include "core/transfer_tiles.h"

namespace refield {

/// One entry of a pixel's row of the transfer.
struct PixelKernel {
  std::optional<std::uint32_t> hat;  ///< its number; nothing: a rectangle
  Box support;
  std::array<float, 3> weight{};  ///< multiplies the sum of texel values under the kernel
  double energy_share = 0.0;      ///< of the pixel's energy (|weight| × area, all channels), 0 to 1
};

/// What a pixel takes light from, most energy first. `pixel` counts row-major. Throws InputError for a pixel
/// that the field does not have.
std::vector<PixelKernel> kernels_of_pixel(const ReflectanceField& field, std::size_t pixel);
/// The same for a transfer laid out in tiles; weights that were rounded to zero are left out.
std::vector<PixelKernel> kernels_of_pixel(const TransferTiles& tiles, const LightBasis& basis,
                                          std::size_t pixel);

/// The reflectance function that the kernels add up to: at each texel the sum of the weights (mean of the
/// channels) of the kernels over it, [height × width × 1] of the light map.
Image kernel_density(const LightBasis& basis, std::span<const PixelKernel> kernels);
Image kernel_density(const ReflectanceField& field, std::size_t pixel);

}  // namespace refield
