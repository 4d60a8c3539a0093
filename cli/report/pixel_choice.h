// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

#include "core/metrics.h"
#include "core/reflectance_field.h"
#include "core/run_context.h"

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
/// training images badly. Dark pixels are left out, and a pixel is judged by the median of its 3 × 3
/// neighbourhood, so that no single noisy pixel is taken. Fewer for tiny images.
std::vector<ChosenPixel> choose_pixels(const ReflectanceField& field, const Mask& mask,
                                       const RunContext& run = {});

}  // namespace refield::report
