// SPDX-License-Identifier: Apache-2.0
#include "cli/chart/label_layout.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <numeric>

namespace refield::chart {

namespace {

constexpr double line_height = 13.0;
constexpr double letter_width = 6.2;  // of 11 px sans-serif, on the safe side
constexpr double marker = 5.0;
constexpr int directions = 16;
constexpr std::array distances = {9.0, 16.0, 26.0, 38.0, 52.0, 70.0, 95.0, 125.0};
constexpr double joined_beyond = 20.0;

/// The label's rectangle when its nearest edge lies `distance` from the point in a direction.
Extent at(double x, double y, double width, double angle, double distance) {
  const double dx = std::cos(angle), dy = std::sin(angle);
  const double cx = x + dx * (distance + width / 2), cy = y + dy * (distance + line_height / 2);
  return {cx - width / 2, cy - line_height / 2, cx + width / 2, cy + line_height / 2};
}

}  // namespace

double text_width(const std::string& text) {
  // Bytes that continue a UTF-8 character take no room.
  const auto letters = std::ranges::count_if(text, [](char c) { return (c & 0xc0) != 0x80; });
  return letter_width * static_cast<double>(letters);
}

std::vector<PlacedLabel> place_labels(const std::vector<std::string>& labels,
                                      const std::vector<std::pair<double, double>>& points,
                                      const std::vector<Extent>& obstacles, const Extent& frame) {
  std::vector<Extent> taken = obstacles;
  for (const auto& [x, y] : points) taken.push_back({x - marker, y - marker, x + marker, y + marker});
  std::vector<PlacedLabel> placed;
  for (std::size_t k = 0; k < labels.size(); ++k) {
    const auto [x, y] = points[k];
    const double width = text_width(labels[k]);
    PlacedLabel label{at(x, y, width, 0.0, distances[0]), false};
    bool found = false;
    for (const double distance : distances) {
      for (int d = 0; d < directions && !found; ++d) {
        const Extent candidate = at(x, y, width, 2.0 * std::numbers::pi * d / directions, distance);
        const bool inside = candidate.x0 >= frame.x0 && candidate.y0 >= frame.y0 &&
                            candidate.x1 <= frame.x1 && candidate.y1 <= frame.y1;
        if (!inside || std::ranges::any_of(taken, [&](const Extent& e) { return e.overlaps(candidate); }))
          continue;
        label = {candidate, distance > joined_beyond};
        found = true;
      }
      if (found) break;
    }
    taken.push_back(label.extent);
    placed.push_back(label);
  }
  return placed;
}

std::vector<double> spread_apart(const std::vector<double>& wanted, double gap, double low, double high) {
  std::vector<std::size_t> order(wanted.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::stable_sort(order, {}, [&](std::size_t k) { return wanted[k]; });
  std::vector<double> at = wanted;
  // Down, then up: what the lower end pushes back stays apart.
  double least = low;
  for (const std::size_t k : order) {
    at[k] = std::max(at[k], least);
    least = at[k] + gap;
  }
  double most = high;
  for (auto k = order.rbegin(); k != order.rend(); ++k) {
    at[*k] = std::min(at[*k], most);
    most = at[*k] - gap;
  }
  return at;
}

}  // namespace refield::chart
