// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "core/box.h"
#include "core/light_map.h"

namespace refield {

/// A light basis made of rectangles over a light map: the kernels R_k of Matusik et al. 2004, eq. 3, as one
/// dictionary that all pixels share, so that each rectangle is summed once a light.
struct BoxBasis {
  LightDomain domain;
  std::vector<Box> boxes;

  /// Coefficients [boxes × 3]: the sum of the light's texel values in each box, R_k · L of eq. 4.
  /// Throws InputError when the light's size or parameterisation differs from the domain.
  std::vector<float> project(const LightMap& light) const;
};

}  // namespace refield
