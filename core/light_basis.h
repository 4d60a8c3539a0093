// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "core/box.h"
#include "core/hat_grid.h"
#include "core/light_map.h"

namespace refield {

/// What coefficients sum: a light map's values as they stand, as estimation does with photographs of a
/// monitor's image, or each value times its texel's solid angle, as precomputed transport does (cube maps
/// alone).
enum class Measure { texels, solid_angle };

/// The kernels over a light map that all pixels share, so that each is summed once a light: hat functions
/// for what is smooth, rectangles for the rest (R_k of Matusik et al. 2004, eq. 3). Kernel k is hat k for
/// k < hats.count(), else box k − hats.count().
struct LightBasis {
  LightDomain domain;
  HatGrid hats;
  std::vector<Box> boxes;
  Measure measure = Measure::texels;

  std::size_t size() const { return hats.count() + boxes.size(); }
  bool is_hat(std::size_t kernel) const { return kernel < static_cast<std::size_t>(hats.count()); }
  const Box& box(std::size_t kernel) const { return boxes[kernel - hats.count()]; }

  /// Texels of a box; of a hat, the sum of its values.
  double area(std::size_t kernel) const;
  /// Value of a kernel at a texel: of a box 1 inside, else 0.
  float value(std::size_t kernel, int x, int y) const;
  /// The rectangle outside which a kernel is zero.
  Box support(std::size_t kernel) const;

  /// Coefficients [size × 3]: the sum of the light's texel values over each kernel, R_k · L of eq. 4.
  /// Throws InputError when the light's size or parameterisation differs from the domain.
  std::vector<float> project(const LightMap& light) const;
};

}  // namespace refield
