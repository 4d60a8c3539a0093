// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

namespace refield::chart {

/// A rectangle in pixels.
struct Extent {
  double x0, y0, x1, y1;
  bool overlaps(const Extent& other) const {
    return x0 < other.x1 && other.x0 < x1 && y0 < other.y1 && other.y0 < y1;
  }
};

struct PlacedLabel {
  Extent extent;
  bool far = false;  ///< so far from its point that a line should join them
};

/// Pixels that a text takes in panel labels, roughly.
double text_width(const std::string& text);

/// Places a label for each point, in order: beside, above or below it, further and further away until it
/// keeps clear of all points, of `obstacles` and of earlier labels, and lies inside `frame`. Where no place
/// is free the label stays beside its point.
std::vector<PlacedLabel> place_labels(const std::vector<std::string>& labels,
                                      const std::vector<std::pair<double, double>>& points,
                                      const std::vector<Extent>& obstacles, const Extent& frame);

/// Vertical centres as close as can be to `wanted`, in any order, at least `gap` apart and inside
/// [low, high] where there is room.
std::vector<double> spread_apart(const std::vector<double>& wanted, double gap, double low, double high);

}  // namespace refield::chart
