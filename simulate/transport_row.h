// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <vector>

#include "simulate/light_hierarchy.h"
#include "simulate/scene_description.h"

namespace refield {

/// One box of a pixel's row of T: the weights multiply the *sum* of the texel values in the box.
struct TransportEntry {
  std::uint32_t node;  ///< of the LightHierarchy
  float weight[3];
};

/// Gathers one row of T at a time, from any number of contributions in any order.
class TransportRow {
 public:
  explicit TransportRow(const LightHierarchy& hierarchy);

  /// Adds weight · (sum of the node's texels) to the pixel.
  void add(std::uint32_t node, const Rgb& weight) {
    if (!is_touched_[node]) {
      is_touched_[node] = 1;
      touched_.push_back(node);
    }
    sum_[node] += weight;
  }
  /// Adds weight · (mean of the node's texels).
  void add_mean(std::uint32_t node, const Rgb& weight) {
    add(node, weight / static_cast<float>(hierarchy_->box(node).area()));
  }

  /// The row, by ascending nodes, and an empty accumulator. Entries with less than 1e-5 of the pixel's light
  /// are dropped and the others scaled up, a channel each, so that the pixel under white light stays what it
  /// was.
  std::vector<TransportEntry> take();

 private:
  const LightHierarchy* hierarchy_;
  std::vector<Rgb> sum_;  // [nodes], zero outside `touched_`
  std::vector<std::uint32_t> touched_;
  std::vector<char> is_touched_;
};

}  // namespace refield
