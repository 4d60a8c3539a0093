// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>

#include "core/base/rng.h"
#include "simulate/prt/harmonic_transfer.h"

namespace refield::prt::test {

/// Light that is a sum of harmonics, coloured and positive everywhere.
struct HarmonicLight {
  int order;
  Eigen::Matrix<double, Eigen::Dynamic, 3> coefficients;  // [order² × 3]

  Eigen::Array3f operator()(const Eigen::Vector3f& direction) const;
};
HarmonicLight random_harmonic_light(int order, std::uint64_t seed);

/// Radiance of a vertex towards a viewer (unit direction; any, where all is diffuse), its colour included.
Eigen::Array3f radiance(const HarmonicTransfer& transfer, const Scene& scene, const HarmonicLight& light,
                        std::size_t vertex, const Eigen::Vector3f& to_viewer);

/// White light of radiance one from all directions within an angle (radians) of one.
HarmonicLight cap_light(const Eigen::Vector3f& middle, double half_angle, int order);

}  // namespace refield::prt::test
