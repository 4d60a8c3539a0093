// SPDX-License-Identifier: Apache-2.0
#include "simulate/tabletop/transport_row.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace refield {

namespace {
constexpr int coarsest_share_of_width = 16;
}

LightHierarchy::LightHierarchy(const LightDomain& domain) : domain_(domain) {
  for (int level = 0; level == 0 || (1 << level) * coarsest_share_of_width <= domain.width; ++level) {
    const int side = 1 << level;
    levels_.push_back({size_, (domain.width + side - 1) / side, (domain.height + side - 1) / side});
    size_ += static_cast<std::uint32_t>(levels_.back().columns) * levels_.back().rows;
  }
}

Box LightHierarchy::box(int level, int column, int row) const {
  return {column << level, row << level, std::min((column + 1) << level, domain_.width),
          std::min((row + 1) << level, domain_.height)};
}

Box LightHierarchy::box(std::uint32_t node) const {
  int level = coarsest_level();
  while (levels_[level].first > node) --level;
  const auto within = static_cast<int>(node - levels_[level].first);
  return box(level, within % levels_[level].columns, within / levels_[level].columns);
}

namespace {
constexpr double negligible_share = 1e-5;
}

TransportRow::TransportRow(const LightHierarchy& hierarchy)
    : hierarchy_(&hierarchy), sum_(hierarchy.size(), Rgb::Zero()), is_touched_(hierarchy.size(), 0) {}

std::vector<TransportEntry> TransportRow::take() {
  std::ranges::sort(touched_);
  const auto light_of = [&](std::uint32_t node) {  // under a white light
    return (sum_[node] * static_cast<float>(hierarchy_->box(node).area())).cast<double>().eval();
  };
  Eigen::Array3d total = Eigen::Array3d::Zero(), kept = Eigen::Array3d::Zero();
  for (std::uint32_t node : touched_) total += light_of(node);
  const double negligible = negligible_share * total.sum();
  const auto matters = [&](std::uint32_t node) { return light_of(node).sum() > negligible; };
  for (std::uint32_t node : touched_)
    if (matters(node)) kept += light_of(node);
  const Rgb scale = (kept > 0.0).select(total / kept, 1.0).cast<float>();

  std::vector<TransportEntry> entries;
  for (std::uint32_t node : touched_) {
    if (matters(node)) {
      const Rgb weight = sum_[node] * scale;
      entries.push_back({node, {weight[0], weight[1], weight[2]}});
    }
    sum_[node] = Rgb::Zero();
    is_touched_[node] = 0;
  }
  touched_.clear();
  return entries;
}

namespace {

/// A footprint is made of boxes of the level on which it spans at most this many a side.
constexpr float max_boxes_a_side = 8.0f;

/// The part of [low, high) that lies in [begin, end).
float overlap(float low, float high, int begin, int end) {
  return std::max(0.0f, std::min(high, static_cast<float>(end)) - std::max(low, static_cast<float>(begin)));
}

}  // namespace

Eigen::Vector2f SpecularFootprints::extent(const Sample& sample) const {
  // Mean step to the neighbours in each direction of the grid; together they span the sample's parallelogram.
  Eigen::Vector2f sum = Eigen::Vector2f::Zero();
  for (const bool across : {true, false}) {
    Eigen::Vector2f steps = Eigen::Vector2f::Zero();
    int count = 0;
    for (const Sample& other : samples_) {
      const int di = std::abs(other.i - sample.i), dj = std::abs(other.j - sample.j);
      if (other.path != sample.path || di != (across ? 1 : 0) || dj != (across ? 0 : 1)) continue;
      steps += (other.position - sample.position).cwiseAbs();
      ++count;
    }
    if (count > 0) sum += steps / static_cast<float>(count);
  }
  return sum;
}

void SpecularFootprints::deposit(const LightHierarchy& hierarchy, TransportRow& row) const {
  const LightDomain& domain = hierarchy.domain();
  const auto clipped = [](float centre, float extent, int size) {
    const auto length = static_cast<float>(size);
    const float half = std::max(0.5f * extent, 1e-3f);
    return std::pair{std::clamp(centre - half, 0.0f, length - 1e-3f),
                     std::clamp(centre + half, 1e-3f, length)};
  };
  for (const Sample& sample : samples_) {
    const Eigen::Vector2f size = extent(sample);
    int level = 0;
    while (level < hierarchy.coarsest_level() && std::ldexp(max_boxes_a_side, level) < size.maxCoeff())
      ++level;
    const auto [left, right] = clipped(sample.position.x(), size.x(), domain.width);
    const auto [top, bottom] = clipped(sample.position.y(), size.y(), domain.height);
    const float area = (right - left) * (bottom - top);
    for (int j = static_cast<int>(top) >> level; j < hierarchy.rows(level); ++j) {
      if (static_cast<float>(j << level) >= bottom) break;
      for (int i = static_cast<int>(left) >> level; i < hierarchy.columns(level); ++i) {
        if (static_cast<float>(i << level) >= right) break;
        const Box box = hierarchy.box(level, i, j);
        const float share =
            overlap(left, right, box.x0, box.x1) * overlap(top, bottom, box.y0, box.y1) / area;
        if (share > 0.0f) row.add_mean(hierarchy.node(level, i, j), sample.throughput * share);
      }
    }
  }
}

}  // namespace refield
