// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <memory>

#include "simulate/dynamic/brdf_table.h"

namespace refield::dynamic {

/// What reflects beside the diffuse part.
enum class Lobe { none, phong, ggx, table };

/// An isotropic reflectance distribution, 1/sr, RGB, in a frame whose z is the normal. Both directions are
/// unit and point away from the surface; below the horizon it is zero. The cosine is not part of it.
///  - phong: specular · (n + 2)/2π · max(r · ω_o, 0)ⁿ, r the mirror direction of ω, n the exponent (as
///    prt::Material)
///  - ggx: D F G/(4 cosθ cosθ_o) with the normals' distribution D of Trowbridge and Reitz, G by Smith, of
///  both
///    directions together (Walter et al. 2007; Heitz 2014, eq. 99), F by Schlick with `specular` as
///    reflectance at normal incidence; roughness is their α itself, not its root
///  - table: specular · what was measured
struct Brdf {
  Eigen::Array3f diffuse = {0.8f, 0.8f, 0.8f};  ///< reflectance, added as diffuse/π
  Eigen::Array3f specular = {0.0f, 0.0f, 0.0f};
  Lobe lobe = Lobe::none;
  float exponent = 0.0f;
  float roughness = 1.0f;
  std::shared_ptr<const BrdfTable> table = nullptr;  ///< of Lobe::table

  Eigen::Array3f operator()(const Eigen::Vector3f& in, const Eigen::Vector3f& out) const;
  /// Throws InputError for reflectances that are negative or not finite, an exponent outside [0, 1e5], a
  /// roughness outside [0.01, 1], a missing table.
  void check() const;
};

}  // namespace refield::dynamic
