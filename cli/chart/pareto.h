// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <vector>

namespace refield::chart {

/// The points that no other point beats in both coordinates (smaller is better), by rising x. Of equal points
/// one stays; points that are not finite never do. Returns their places in `points`.
std::vector<std::size_t> pareto_front(const std::vector<std::array<double, 2>>& points);

}  // namespace refield::chart
