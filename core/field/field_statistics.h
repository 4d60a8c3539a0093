// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/field/reflectance_field.h"
#include "core/field/transfer_tiles.h"
#include "core/image/image.h"
#include "core/light/light_map.h"
#include "refield/field.h"

namespace refield {

/// What a pixel takes light from, most energy first. `pixel` counts row-major. Throws InputError for a pixel
/// that the field does not have.
std::vector<PixelKernel> kernels_of_pixel(const ReflectanceField& field, std::size_t pixel);
/// Kernels of a pixel of a transfer in tiles; weights that were rounded to zero are left out.
std::vector<PixelKernel> kernels_of_pixel(const TransferTiles& tiles, const LightBasis& basis,
                                          std::size_t pixel);

/// The reflectance function that the kernels add up to: at each texel the sum of the weights (mean of the
/// channels) of the kernels over it, [height × width × 1] of the light map.
Image kernel_density(const LightBasis& basis, std::span<const PixelKernel> kernels);
Image kernel_density(const ReflectanceField& field, std::size_t pixel);

/// How many kernels a field has and where their energy lies. The energy of a kernel is Σ_channels |weight|
/// × area: what it adds to its pixel, or takes away, under a white light of radiance one.
struct KernelStatistics {
  std::uint64_t pixels = 0;  ///< that have at least one kernel
  std::uint64_t kernels =
      0;  ///< allowed in those pixels: pixels × kernels per pixel; the 100 % of the shares below
  std::uint64_t stored = 0;  ///< entries of the transfer
  std::uint64_t distinct_boxes = 0;
  double mean_stored = 0.0;          ///< entries per pixel, over `pixels`
  double nonzero_share = 0.0;        ///< kernels with a weight that is not zero in some channel
  double share_of_99_percent = 0.0;  ///< the fewest kernels that hold 99 % of the scene's energy
  double share_of_95_percent = 0.0;
  /// [most entries per pixel + 1], pixels with that many entries; pixels outside the mask stand under 0.
  std::vector<std::uint64_t> histogram;
};

/// `kernels_per_pixel` is the cap that the field was estimated with: estimation drops kernels of weight zero,
/// so the field alone does not tell how many there were. 0: the most that any pixel has. Source: Matusik et
/// al. 2004, table 1.
KernelStatistics kernel_statistics(const ReflectanceField& field, int kernels_per_pixel = 0);

}  // namespace refield
