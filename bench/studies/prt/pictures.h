// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <filesystem>
#include <vector>

#include "bench/studies/prt/peers.h"

namespace refield::prt_chart {

/// The radiance difference that is shown as the brightest false colour, as a share of the exact picture's
/// 99 % quantile: errors of a per cent are to be seen.
inline constexpr double brightest_difference = 0.1;

/// One picture as figure 9 of Johan and Nishita has it: a row for each method, the exact picture at its left
/// end, then one for each setting, and below each its absolute difference to the exact one in false colours.
/// `exact` and the peers' first shading: all vertices, in order. The scene's camera or one that sees all.
void write_comparison(const std::filesystem::path& path, const prt::Scene& scene,
                      const std::vector<Eigen::Array3f>& exact, const std::vector<Peer>& peers);

}  // namespace refield::prt_chart
