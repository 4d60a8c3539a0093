// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "simulate/transport_row.h"

namespace refield {

/// What one pixel sees of the monitor by way of mirrors and glass alone.
///
/// A pixel's samples, one a cell of a grid, meet the monitor at points; the pixel sees all that lies between
/// them. So each sample stands for the area up to halfway to its neighbours, as ray differentials do (Igehy
/// 1999): points would leave gaps wherever a curved mirror spreads a pixel over more texels than it has
/// samples.
class SpecularFootprints {
 public:
  void clear() { samples_.clear(); }

  /// A sample of grid cell (i, j) that reached the monitor at `position` (column, row, in texels). `path`
  /// tells reflections from refractions on the way: only samples of the same path are neighbours.
  void add(int i, int j, std::uint32_t path, const Eigen::Vector2f& position, const Rgb& throughput) {
    samples_.push_back({i, j, path, position, throughput});
  }

  /// Spreads every sample over its footprint, an upright rectangle cut off at the monitor's rim. Nothing is
  /// lost.
  void deposit(const LightHierarchy& hierarchy, TransportRow& row) const;

 private:
  struct Sample {
    int i, j;
    std::uint32_t path;
    Eigen::Vector2f position;
    Rgb throughput;
  };
  Eigen::Vector2f extent(const Sample& sample) const;
  std::vector<Sample> samples_;
};

}  // namespace refield
