// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <memory>

#include "core/field/light_interpolation.h"
#include "core/image/image.h"
#include "core/light/harmonics.h"
#include "core/light/light_map.h"

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
  /// Projects light that is zero outside `within`: `radiance` holds that part of the domain alone.
  std::vector<double> project(const Image& radiance, const Box& within, const LightDomain& domain) const;
};

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

/// A box of one face of a cube map in which light counts by a linear function of its direction ω, vector · ω.
/// Its coefficient is the product of the vector with the light vector of the box, ∫ L ω dω (Gershun 1939). A
/// white Lambertian surface that sees all of a box reflects that much with vector = normal ∕ π: one kernel
/// says what takes many boxes of constant weight.
struct VectorBox {
  Box box;
  Eigen::Vector3f vector = Eigen::Vector3f::Zero();  ///< in the axes of light directions

  bool operator==(const VectorBox&) const = default;
};

/// The first of each run of kernels with the same box, then their number.
std::vector<std::size_t> firsts_of_boxes(std::span<const VectorBox> kernels);

/// Sums light over vector boxes: over each texel once, however many boxes lie on it.
class VectorBoxTable {
 public:
  /// `resolution` R of the cube map. Takes 12 R² bytes, and 72 bytes for each crossing of boxes' edges while
  /// it sums.
  VectorBoxTable(std::span<const VectorBox> kernels, int resolution);

  /// Coefficients [kernels × 3] of radiance times solid angle that is zero outside `within`; `part` holds
  /// that rectangle. Runs on all cores.
  std::vector<double> project(const Image& part, const Box& within) const;

 private:
  /// Where boxes begin and end on a face, in texels; ascending.
  struct Face {
    std::vector<int> columns, rows;
  };
  /// A box, in places of its face's columns and rows, and the first of its kernels.
  struct Place {
    int face = 0, column0 = 0, column1 = 0, row0 = 0, row1 = 0;
    std::size_t first = 0;
  };
  class FaceSums;

  int resolution_;
  std::array<Face, 6> faces_;
  std::vector<Place> places_;             // of successive kernels of one box, one
  std::vector<Eigen::Vector3d> vectors_;  // [kernels], in the axes of their face
  std::vector<Eigen::Vector3f> means_;    // [R²], mean direction of each texel of a face
};

/// What coefficients sum: a light map's values as they stand, as estimation does with photographs of a
/// monitor's image, or each value times its texel's solid angle, as precomputed transport does (cube maps
/// alone).
enum class Measure { texels, solid_angle };

/// The kernels over a light map that all pixels share, so that each is summed once a light: hat functions and
/// spherical harmonics for what is smooth, rectangles for the rest (R_k of Matusik et al. 2004, eq. 3).
/// Kernels are numbered hats first, then harmonics, vector boxes and boxes.
struct LightBasis {
  LightDomain domain;
  HatGrid hats;
  std::vector<Box> boxes;
  Measure measure = Measure::texels;
  HarmonicKernels harmonics = {};  ///< with Measure::solid_angle alone
  /// How light on texels that were black in all training lights counts; without it, as it stands.
  std::optional<LightInterpolation> interpolation = {};
  std::vector<VectorBox> vector_boxes = {};  ///< with Measure::solid_angle alone; those of a box successive

  /// All but boxes.
  std::size_t smooth() const { return first_vector_box() + vector_boxes.size(); }
  std::size_t first_vector_box() const {
    return static_cast<std::size_t>(hats.count()) + static_cast<std::size_t>(harmonics.count());
  }
  bool is_vector_box(std::size_t kernel) const { return kernel >= first_vector_box() && is_smooth(kernel); }
  std::size_t size() const { return smooth() + boxes.size(); }
  bool is_smooth(std::size_t kernel) const { return kernel < smooth(); }
  const Box& box(std::size_t kernel) const { return boxes[kernel - smooth()]; }

  /// A kernel's coefficient under a light of one everywhere: of a box its texels or its solid angle.
  /// For a vector box, the magnitudes of its values, to about a tenth; for a harmonic, what does not cancel.
  double area(std::size_t kernel) const;
  /// Value of a kernel at a texel, the mean over it: of a box 1 inside, else 0.
  float value(std::size_t kernel, int x, int y) const;
  /// The rectangle outside which a kernel is zero.
  Box support(std::size_t kernel) const;

  /// Coefficients [size × 3]: the sum of the light's texel values, by `measure` and `interpolation`, over
  /// each kernel, R_k · L of eq. 4. Throws InputError when the light's size or parameterisation differs from
  /// the domain.
  std::vector<float> project(const LightMap& light) const;
};

/// Sums light over the smooth kernels of a basis; keeps what each light needs anew.
class SmoothProjector {
 public:
  explicit SmoothProjector(const LightBasis& basis);

  std::size_t count() const { return count_; }
  bool weighs() const { return !solid_angles_.empty() || interpolator_; }
  /// Whether weigh() changes each texel on its own, so that it may be applied to a part of the domain.
  bool weighs_texels_alone() const { return !interpolator_; }
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
  std::optional<VectorBoxTable> vector_boxes_;
  std::shared_ptr<const LightInterpolator> interpolator_;
};

}  // namespace refield
