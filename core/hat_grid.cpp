// SPDX-License-Identifier: Apache-2.0
#include "core/hat_grid.h"

#include <tbb/parallel_for.h>

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

/// Texels [first, last) whose centres lie between two nodes, the first of which is `node`.
struct Interval {
  int node = 0;
  int first = 0;
  int last = 0;
};

std::vector<Interval> intervals(int first, int last, int texels, int nodes) {
  std::vector<Interval> found;
  for (int texel = first; texel < last; ++texel) {
    const int node = std::min(static_cast<int>(position(texel, texels, nodes)), std::max(nodes - 2, 0));
    if (found.empty() || found.back().node != node) found.push_back({node, texel, texel});
    found.back().last = texel + 1;
  }
  return found;
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
  return project(light.radiance, {0, 0, domain.width, domain.height}, domain);
}

std::vector<double> HatGrid::project(const Image& radiance, const Box& within,
                                     const LightDomain& domain) const {
  if (count() == 0) return {};
  // Between two nodes a row gives its light to both, in parts that are linear in x: the sum of the light and
  // of its share for the right node say it all, two products a texel and channel.
  const auto row_values = static_cast<std::size_t>(columns) * 3;
  std::vector<double> along_rows(row_values * static_cast<std::size_t>(within.height()), 0.0);
  const std::vector<Interval> across = intervals(within.x0, within.x1, domain.width, columns);
  std::vector<double> shares;
  for (const Interval& interval : across)
    for (int x = interval.first; x < interval.last; ++x)
      shares.push_back(position(x, domain.width, columns) - interval.node);
  tbb::parallel_for(0, within.height(), [&](int y) {
    double* along_row = along_rows.data() + row_values * static_cast<std::size_t>(y);
    const float* texel = radiance.row(y).data();
    const double* share = shares.data();
    for (const Interval& interval : across) {
      // Two texels at a time: a sum waits half as often for the one before.
      double sum[6] = {}, right[6] = {};
      int x = interval.first;
      for (; x + 1 < interval.last; x += 2, texel += 6, share += 2)
        for (int i = 0; i < 6; ++i) {
          sum[i] += texel[i];
          right[i] += share[i / 3] * texel[i];
        }
      for (; x < interval.last; ++x, texel += 3, ++share)
        for (int c = 0; c < 3; ++c) {
          sum[c] += texel[c];
          right[c] += *share * texel[c];
        }
      for (int c = 0; c < 3; ++c) {
        sum[c] += sum[c + 3];
        right[c] += right[c + 3];
      }
      for (int c = 0; c < 3; ++c) {
        if (interval.node + 1 < columns) along_row[3 * (interval.node + 1) + c] += right[c];
        along_row[3 * interval.node + c] += sum[c] - right[c];
      }
    }
  });
  std::vector<double> coefficients(static_cast<std::size_t>(count()) * 3);
  for (const Interval& interval : intervals(within.y0, within.y1, domain.height, rows))
    for (int y = interval.first; y < interval.last; ++y) {
      const double share = position(y, domain.height, rows) - interval.node;
      const double* along_row = along_rows.data() + row_values * static_cast<std::size_t>(y - within.y0);
      double* upper = coefficients.data() + row_values * static_cast<std::size_t>(interval.node);
      for (std::size_t i = 0; i < row_values; ++i) {
        upper[i] += (1.0 - share) * along_row[i];
        if (interval.node + 1 < rows) upper[row_values + i] += share * along_row[i];
      }
    }
  return coefficients;
}

}  // namespace refield
