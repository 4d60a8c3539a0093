// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "core/box.h"
#include "core/harmonics.h"
#include "core/image.h"
#include "core/light_map.h"

namespace refield {

/// Spherical harmonics as kernels over a cube map. Transfer matrices hold no negative weights, so each
/// harmonic is there twice: kernel 2i is harmonic i, kernel 2i + 1 its negative.
struct HarmonicKernels {
  int order = 0;  ///< 0: none; at most largest_harmonics_order

  int count() const { return 2 * harmonics_of(order); }
  bool operator==(const HarmonicKernels&) const = default;

  /// Mean of a kernel over the solid angle of texel (x, y).
  float value(int kernel, int x, int y, const LightDomain& domain) const;
};

/// The harmonics at all texels of a cube map, so that light is projected by products alone.
/// Takes order² floats a texel: small maps are meant, since harmonics of low order see no more.
class HarmonicTable {
 public:
  HarmonicTable(const HarmonicKernels& kernels, const LightDomain& domain);

  /// Coefficients [kernels × 3] of radiance times solid angle that is zero outside `within`; `part` holds
  /// that rectangle.
  std::vector<double> project(const Image& part, const Box& within) const;

 private:
  LightDomain domain_;
  std::size_t functions_;
  std::vector<float> values_;  // [texels × functions]
};

}  // namespace refield
