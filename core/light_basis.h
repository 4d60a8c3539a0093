// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <vector>

#include "core/box.h"
#include "core/harmonic_kernels.h"
#include "core/hat_grid.h"
#include "core/light_map.h"

namespace refield {

/// What coefficients sum: a light map's values as they stand, as estimation does with photographs of a
/// monitor's image, or each value times its texel's solid angle, as precomputed transport does (cube maps
/// alone).
enum class Measure { texels, solid_angle };

/// The kernels over a light map that all pixels share, so that each is summed once a light: hat functions and
/// spherical harmonics for what is smooth, rectangles for the rest (R_k of Matusik et al. 2004, eq. 3).
/// Kernels are numbered hats first, then harmonics, then boxes.
struct LightBasis {
  LightDomain domain;
  HatGrid hats;
  std::vector<Box> boxes;
  Measure measure = Measure::texels;
  HarmonicKernels harmonics = {};  ///< with Measure::solid_angle alone

  /// Hats and harmonics.
  std::size_t smooth() const { return static_cast<std::size_t>(hats.count()) + harmonics.count(); }
  std::size_t size() const { return smooth() + boxes.size(); }
  bool is_smooth(std::size_t kernel) const { return kernel < smooth(); }
  const Box& box(std::size_t kernel) const { return boxes[kernel - smooth()]; }

  /// A kernel's coefficient under a light of one everywhere: of a box its texels or its solid angle.
  double area(std::size_t kernel) const;
  /// Value of a kernel at a texel: of a box 1 inside, else 0.
  float value(std::size_t kernel, int x, int y) const;
  /// The rectangle outside which a kernel is zero.
  Box support(std::size_t kernel) const;

  /// Coefficients [size × 3]: the sum of the light's texel values, by `measure`, over each kernel, R_k · L of
  /// eq. 4. Throws InputError when the light's size or parameterisation differs from the domain.
  std::vector<float> project(const LightMap& light) const;
};

/// Sums light over the smooth kernels of a basis; keeps what each light needs anew.
class SmoothProjector {
 public:
  explicit SmoothProjector(const LightBasis& basis);

  std::size_t count() const { return count_; }
  bool weighs() const { return !solid_angles_.empty(); }
  /// Replaces radiance by what coefficients sum: `part` holds the rectangle `within` of the domain.
  void weigh(Image& part, const Box& within) const;
  /// Coefficients [count × 3] of light that is zero outside `within`, weighed already.
  std::vector<double> project(const Image& part, const Box& within) const;

 private:
  LightDomain domain_;
  HatGrid hats_;
  std::size_t count_;
  std::vector<float> solid_angles_;  // of a cube map's face
  std::optional<HarmonicTable> harmonics_;
};

}  // namespace refield
