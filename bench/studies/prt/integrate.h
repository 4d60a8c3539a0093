// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/light/light_map.h"
#include "simulate/prt/transfer_samples.h"

namespace refield::prt {

/// What clustering approximates, light by light: for each light map and each output of `transfer`, in its
/// order, the sum over all 6 R² texels of radiance × the texel's solid angle × transfer from the texel's
/// centre (Johan and Nishita, eq. 4). [lights][groups × 16] RGB. The maps are cubes of one size; throws
/// InputError otherwise. One ray for each output and texel: for some hundred outputs, not for all.
std::vector<std::vector<Eigen::Array3d>> integrate_lights(const TransferSamples& transfer,
                                                          std::span<const LightMap> lights,
                                                          const RunContext& run = {});

}  // namespace refield::prt
