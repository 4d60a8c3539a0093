// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>

#include <cmath>

namespace refield::dynamic {

/// Rows: tangent, bitangent, normal; orthonormal for any unit normal, without branches (Duff et al. 2017,
/// "Building an orthonormal basis, revisited"). Times a direction it gives the direction in the local frame,
/// z along the normal. The tangent jumps where the normal's z changes its sign: only what does not depend on
/// the turn about the normal (isotropic reflection) may be carried from vertex to vertex.
inline Eigen::Matrix3f tangent_frame(const Eigen::Vector3f& normal) {
  const float sign = std::copysign(1.0f, normal.z());
  const float a = -1.0f / (sign + normal.z());
  const float b = normal.x() * normal.y() * a;
  Eigen::Matrix3f frame;
  frame.row(0) << 1.0f + sign * normal.x() * normal.x() * a, sign * b, -sign * normal.x();
  frame.row(1) << b, sign + normal.y() * normal.y() * a, -normal.y();
  frame.row(2) = normal.transpose();
  return frame;
}

/// What reflects beside the diffuse part.
enum class Lobe { none, phong, ggx };

/// An isotropic reflectance distribution, 1/sr, RGB, in a frame whose z is the normal. Both directions are
/// unit and point away from the surface; below the horizon it is zero. The cosine is not part of it.
///  - phong: specular · (n + 2)/2π · max(r · ω_o, 0)ⁿ, r the mirror direction of ω, n the exponent (as
///    prt::Material)
///  - ggx: D F G/(4 cosθ cosθ_o) with the normals' distribution D of Trowbridge and Reitz, G by Smith, of
///  both
///    directions together (Walter et al. 2007; Heitz 2014, eq. 99), F by Schlick with `specular` as
///    reflectance at normal incidence; roughness is their α itself, not its root
struct Brdf {
  Eigen::Array3f diffuse = {0.8f, 0.8f, 0.8f};  ///< reflectance, added as diffuse/π
  Eigen::Array3f specular = {0.0f, 0.0f, 0.0f};
  Lobe lobe = Lobe::none;
  float exponent = 0.0f;   ///< 0 to 1e5
  float roughness = 1.0f;  ///< 0.01 to 1

  Eigen::Array3f operator()(const Eigen::Vector3f& in, const Eigen::Vector3f& out) const;
};

}  // namespace refield::dynamic
