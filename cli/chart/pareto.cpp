// SPDX-License-Identifier: Apache-2.0
#include "cli/chart/pareto.h"

#include <algorithm>
#include <cmath>

namespace refield::chart {

std::vector<std::size_t> pareto_front(const std::vector<std::array<double, 2>>& points) {
  std::vector<std::size_t> order;
  for (std::size_t k = 0; k < points.size(); ++k)
    if (std::isfinite(points[k][0]) && std::isfinite(points[k][1])) order.push_back(k);
  std::ranges::stable_sort(order, [&](std::size_t a, std::size_t b) { return points[a] < points[b]; });
  std::vector<std::size_t> front;
  for (const std::size_t k : order)
    if (front.empty() || points[k][1] < points[front.back()][1]) front.push_back(k);
  return front;
}

}  // namespace refield::chart
