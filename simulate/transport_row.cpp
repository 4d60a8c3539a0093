// SPDX-License-Identifier: Apache-2.0
#include "simulate/transport_row.h"

#include <algorithm>

namespace refield {

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

}  // namespace refield
