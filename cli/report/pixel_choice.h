// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "cli/report/input.h"
#include "core/field/field_statistics.h"
#include "core/field/reflectance_field.h"

namespace refield::report {

/// How the light that a pixel answers to lies in the light map. Energy of a kernel: weight × area, mean of
/// the channels.
struct KernelSpread {
  double energy = 0.0;  ///< the pixel's value under white light of radiance one
  double spread = 0.0;  ///< standard deviation of the position of energy, as a share of the map's diagonal
  double peak = 0.0;    ///< highest weight of a kernel over the mean weight of the whole map, unitless
};

/// [pixels]
std::vector<KernelSpread> kernel_spreads(const ReflectanceField& field, const RunContext& run = {});

/// A pixel whose kernels the report shows.
struct ChosenPixel {
  int x = 0;
  int y = 0;
  std::string kind;  ///< in a few words, why it was chosen
};

/// Pixels of different kind, read off the kernels alone: concentrated (as mirrors and glass are), narrow, a
/// peak over a broad base (glossy), the middle one, broad and even (diffuse), and one that fits its own
/// training images badly. Dark pixels are left out, and a pixel is assessed by the median of its 3 × 3
/// neighbourhood, so that no single noisy pixel is taken. Fewer for tiny images.
std::vector<ChosenPixel> choose_pixels(const ReflectanceField& field, const Mask& mask,
                                       const RunContext& run = {});

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
