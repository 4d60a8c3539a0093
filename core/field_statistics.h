// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <vector>

#include "core/reflectance_field.h"

namespace refield {

/// How many kernels a field has and where their energy lies. The energy of a kernel is Σ_channels |weight|
/// × area: what it adds to its pixel, or takes away, under a white light of radiance one.
struct KernelStatistics {
  std::uint64_t pixels = 0;  ///< that have at least one kernel
  std::uint64_t kernels =
      0;  ///< allowed in those pixels: pixels × kernels a pixel; the 100 % of the shares below
  std::uint64_t stored = 0;  ///< entries of the transfer
  std::uint64_t distinct_boxes = 0;
  double mean_stored = 0.0;          ///< entries a pixel, over `pixels`
  double nonzero_share = 0.0;        ///< kernels with a weight that is not zero in some channel
  double share_of_99_percent = 0.0;  ///< the fewest kernels that hold 99 % of the scene's energy
  double share_of_95_percent = 0.0;
  /// [most entries a pixel + 1], pixels with so many entries; pixels outside the mask stand under 0.
  std::vector<std::uint64_t> histogram;
};

/// `kernels_a_pixel` is the cap that the field was estimated with: estimation drops kernels of weight zero,
/// so the field alone does not tell how many there were. 0: the most that any pixel has. Source: Matusik et
/// al. 2004, table 1.
KernelStatistics kernel_statistics(const ReflectanceField& field, int kernels_a_pixel = 0);

}  // namespace refield
