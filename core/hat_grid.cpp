// SPDX-License-Identifier: Apache-2.0
#include "core/hat_grid.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace refield {

namespace {

/// Position of a texel's centre in units of the distance between nodes.
double position(int texel, int texels, int nodes) {
  return (texel + 0.5) / texels * (nodes - 1);
}

double hat(double position, int node, int nodes) {
  return nodes == 1 ? 1.0 : std::max(0.0, 1.0 - std::abs(position - node));
}

}  // namespace

float HatGrid::value(int node, int x, int y, const LightDomain& domain) const {
  return static_cast<float>(hat(position(x, domain.width, columns), node % columns, columns) *
                            hat(position(y, domain.height, rows), node / columns, rows));
}

Box HatGrid::support(int node, const LightDomain& domain) const {
  const auto interval = [](int texels, int at, int nodes) -> std::pair<int, int> {
    if (nodes == 1) return {0, texels};
    const double spacing = static_cast<double>(texels) / (nodes - 1);
    return {std::max(0, static_cast<int>(std::floor((at - 1) * spacing))),
            std::min(texels, static_cast<int>(std::ceil((at + 1) * spacing)))};
  };
  const auto [x0, x1] = interval(domain.width, node % columns, columns);
  const auto [y0, y1] = interval(domain.height, node / columns, rows);
  return {x0, y0, x1, y1};
}

std::vector<double> HatGrid::project(const LightMap& light) const {
  const LightDomain domain = light.domain();
  std::vector<double> coefficients(static_cast<std::size_t>(count()) * 3);
  std::vector<double> along_row(static_cast<std::size_t>(columns) * 3);
  for (int y = 0; y < domain.height; ++y) {
    std::ranges::fill(along_row, 0.0);
    for (int x = 0; x < domain.width; ++x) {
      const double p = position(x, domain.width, columns);
      const int first = std::min(static_cast<int>(p), std::max(columns - 2, 0));
      for (int i = first; i < std::min(first + 2, columns); ++i)
        for (int c = 0; c < 3; ++c) along_row[3 * i + c] += hat(p, i, columns) * light.radiance.at(x, y, c);
    }
    const double p = position(y, domain.height, rows);
    const int first = std::min(static_cast<int>(p), std::max(rows - 2, 0));
    for (int j = first; j < std::min(first + 2, rows); ++j)
      for (std::size_t i = 0; i < along_row.size(); ++i)
        coefficients[static_cast<std::size_t>(j) * along_row.size() + i] += hat(p, j, rows) * along_row[i];
  }
  return coefficients;
}

}  // namespace refield
