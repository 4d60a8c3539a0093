// SPDX-License-Identifier: Apache-2.0
#pragma once
// The Gaussian process of a LightInterpolation, for the units that compute with it.

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/field/light_interpolation.h"

namespace refield::gaussian_process {

inline Eigen::Vector3d middle_of(const Box& box, const LightDomain& domain) {
  return lat_long_direction(0.5 * (box.x0 + box.x1), 0.5 * (box.y0 + box.y1), domain.width, domain.height);
}

inline Eigen::MatrixXd directions_of(const std::vector<Box>& sources, const LightDomain& domain) {
  Eigen::MatrixXd directions(static_cast<Eigen::Index>(sources.size()), 3);
  for (std::size_t i = 0; i < sources.size(); ++i)
    directions.row(static_cast<Eigen::Index>(i)) = middle_of(sources[i], domain).transpose();
  return directions;
}

inline Eigen::ArrayXXd chords_of(const Eigen::ArrayXXd& cosines) {
  return (2.0 - 2.0 * cosines).max(0.0).sqrt();
}

inline Eigen::ArrayXXd matern(const Eigen::ArrayXXd& chords, double length) {
  const Eigen::ArrayXXd scaled = std::numbers::sqrt3 / length * chords;
  return (1.0 + scaled) * (-scaled).exp();
}

inline Eigen::ArrayXXd covariance(const LightInterpolation& interpolation, const Eigen::ArrayXXd& chords) {
  return (1.0 - interpolation.fine_share) * matern(chords, interpolation.length) +
         interpolation.fine_share * matern(chords, interpolation.fine_length);
}

/// Keeps the covariance of sources in equal or nearly equal directions positive definite.
inline constexpr double covariance_jitter = 1e-9;

inline Eigen::LLT<Eigen::MatrixXd> factorised(const LightInterpolation& interpolation,
                                              const Eigen::ArrayXXd& chords) {
  Eigen::MatrixXd matrix = covariance(interpolation, chords).matrix();
  matrix.diagonal().array() += covariance_jitter;
  return matrix.llt();
}

/// Part of the effect of light from a direction that stays, from the cosines of its angles to the sources: 1
/// near them, 0 far away.
inline double nearness_of(const LightInterpolation& interpolation, const Eigen::VectorXd& cosines) {
  constexpr double fade = 1.5;  // where the effect ends, as a multiple of the reach
  const double nearest = std::sqrt(std::max(2.0 - 2.0 * cosines.maxCoeff(), 0.0)) / interpolation.reach;
  return std::clamp((fade - nearest) / (fade - 1.0), 0.0, 1.0);
}

}  // namespace refield::gaussian_process
