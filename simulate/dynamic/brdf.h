// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <cmath>
#include <filesystem>
#include <memory>
#include <vector>

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

/// A measured isotropic BRDF, 1/sr, over the angles from the normal and the azimuth between the two
/// directions, which both point away from the surface. θ goes evenly from 0° to 90°, Δφ from 0° (light comes
/// from the viewer's side) to 180° (mirror side), ends included; between samples it is trilinear. It is the
/// same for −Δφ.
class BrdfTable {
 public:
  static constexpr int least = 2, most = 181;  ///< samples of an angle

  /// `values` [theta_in × theta_out × delta_phi], Δφ running fastest. Throws InputError for other counts and
  /// for values that are negative or not finite.
  BrdfTable(int theta_in, int theta_out, int delta_phi, std::vector<Eigen::Array3f> values);

  /// Unit directions above the horizon.
  Eigen::Array3f at(const Eigen::Vector3f& in, const Eigen::Vector3f& out) const;
  int theta_in() const { return theta_in_; }
  int theta_out() const { return theta_out_; }
  int delta_phi() const { return delta_phi_; }
  const std::vector<Eigen::Array3f>& values() const { return values_; }

 private:
  int theta_in_, theta_out_, delta_phi_;
  std::vector<Eigen::Array3f> values_;
};

/// Text:
///
///     refield brdf 1
///     theta_in 16 theta_out 16 delta_phi 19
///     0.31 0.30 0.28
///     …
///
/// R G B of one sample after another; white space separates, and from # to the line's end is a remark. Throws
/// FormatError, naming the sample, for anything else: counts outside [2, 181], too few or too many numbers,
/// words, negative and not finite values.
BrdfTable read_brdf_table(const std::filesystem::path& path);

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
