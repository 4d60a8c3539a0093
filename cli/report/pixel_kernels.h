// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <optional>
#include <span>
#include <vector>

#include "cli/report/input.h"
#include "cli/report/pixel_choice.h"
#include "core/pixel_kernels.h"
#include "core/run_context.h"

namespace refield::report {

/// The reflectance function that kernels add up to: at each texel the sum of the weights (mean of the
/// channels) of the boxes over it, [height × width × 1] of the light map.
Image kernel_density(const LightDomain& domain, std::span<const Box> boxes,
                     std::span<const std::array<float, 3>> weights);

/// How the kernels of a pixel unfold (Matusik et al. 2004, figure 8).
struct PixelKernels {
  ChosenPixel pixel;
  /// [subdivisions], densities; nullopt where no further split was worth it.
  std::vector<std::optional<Image>> after;
  Image in_field;              ///< as the field holds them, after spatial correction
  std::optional<Image> exact;  ///< the pixel's row of the exact transport
};

struct KernelStudy {
  std::vector<int> subdivisions;
  int kernels = 0;  ///< allowed when all subdivisions are done
  std::vector<PixelKernels> pixels;
};

/// Follows the kernels of `pixels` through 1, 2, 3, 4, 5, 10, 20 and 24 subdivisions, as far as the session's
/// training images allow, estimated in the first field's mode.
KernelStudy study_kernels(const ReportInput& input, const std::vector<ChosenPixel>& pixels,
                          const RunContext& run);

}  // namespace refield::report
