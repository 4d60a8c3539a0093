// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "core/light/light_map.h"

namespace refield {

/// Patterns designed for estimation, one after another: saturated dead leaves (docs/method/patterns.md).
///
/// Opaque rectangles of all sizes cover the map, others in each channel (Lee, Mumford and Huang 2001; sizes
/// uniform in the logarithm), and each is 0 or 1. The places are random. The levels are chosen so that a
/// pattern tells as much as possible that those before it have not told: a pixel's response is a Gaussian
/// process whose covariance is that of a pixel that sees one rectangle of unknown place and size, and the
/// levels maximise the variance of the response given the earlier patterns (all channels count, since a
/// pixel's kernels serve all three), with the mean held near one half. Equal arguments give equal patterns.
class LeafPatterns {
 public:
  LeafPatterns(const LightDomain& domain, std::uint64_t seed);
  LightMap next();

 private:
  struct Leaf {
    std::vector<std::pair<int, double>> cells;  ///< of the design grid, with the covered area
    double area = 0.0;                          ///< share of the map
    double variance = 0.0;
  };
  /// The visible leaves; `owner` receives the leaf of each texel.
  std::vector<Leaf> place_leaves(int number, int channel, std::vector<int>& owner) const;
  /// +1 or −1 for each leaf.
  std::vector<int> choose_levels(std::vector<Leaf>& leaves, int number, int channel);

  LightDomain domain_;
  std::uint64_t seed_;
  int columns_, rows_, made_ = 0;
  double noise_variance_;
  Eigen::MatrixXd covariance_;  ///< of the responses to single cells, given the patterns so far
};

}  // namespace refield
