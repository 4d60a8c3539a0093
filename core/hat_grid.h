// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "core/box.h"
#include "core/light_map.h"

namespace refield {

/// Bilinear hat functions over a light map: nodes on a regular grid that reaches from edge to edge, each
/// function 1 at its node and falling linearly to 0 at the next ones. They are non-negative, add up to 1
/// everywhere, and carry the smooth part of light transport (diffuse surfaces under a large monitor), for
/// which rectangles are wasteful.
struct HatGrid {
  int columns = 0;  ///< nodes along x; 1: constant along x
  int rows = 0;     ///< nodes along y

  int count() const { return columns * rows; }
  bool operator==(const HatGrid&) const = default;

  /// Value of function `node` (row by row) at the centre of texel (x, y).
  float value(int node, int x, int y, const LightDomain& domain) const;
  /// The rectangle outside which function `node` is zero.
  Box support(int node, const LightDomain& domain) const;
  /// Coefficients [count × 3]: the light's texel values weighted by each function and summed.
  std::vector<double> project(const LightMap& light) const;
  /// The same for light that is zero outside `within`: `radiance` holds that part of the domain alone.
  std::vector<double> project(const Image& radiance, const Box& within, const LightDomain& domain) const;
};

}  // namespace refield
