// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <array>
#include <span>
#include <vector>

#include "core/light/light_map.h"

namespace refield::peers {

/// A channel of each light as a column, [texels × lights]; texels row-major, top row first.
Eigen::MatrixXd texel_matrix(std::span<const LightMap> lights, int channel);

/// A prior belief about how transport varies over the light map: a stationary Gaussian covariance of the
/// given length scale in texels, exp(−d² / 2ℓ²) between texels at distance d, which factors into its rows'
/// and its columns' share. Length 0: texels are independent, and the product below is the identity.
class TexelCovariance {
 public:
  TexelCovariance(const LightDomain& domain, double length_texels);
  double length_texels() const { return length_; }
  /// Covariance × `texels` [texels × any number of columns].
  Eigen::MatrixXd times(const Eigen::MatrixXd& texels) const;

 private:
  double length_;
  Eigen::MatrixXd along_x_;  // [width × width], symmetric
  Eigen::MatrixXd along_y_;  // [height × height]
};

}  // namespace refield::peers
