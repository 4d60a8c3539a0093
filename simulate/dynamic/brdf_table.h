// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <filesystem>
#include <vector>

namespace refield::dynamic {

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
/// words, negative and not finite values. read_brdf_table(write_brdf_table(t)) is t.
BrdfTable read_brdf_table(const std::filesystem::path& path);
void write_brdf_table(const std::filesystem::path& path, const BrdfTable& table);

}  // namespace refield::dynamic
