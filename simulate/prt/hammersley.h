// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace refield::prt {

/// The binary digits of k behind the point, the lowest first: in [0, 1), well spread for successive k.
double radical_inverse(std::uint32_t k);

/// `count` unit directions, evenly over the sphere: Hammersley's points, the height from the running number,
/// the azimuth from its binary digits reversed (Wong, Luk and Heng 1997). Each stands for 4π ∕ count
/// steradians.
std::vector<Eigen::Vector3d> hammersley_sphere(int count);

}  // namespace refield::prt
