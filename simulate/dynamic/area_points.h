// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <vector>

#include "core/mesh.h"

namespace refield::dynamic {

/// A point that stands for a piece of a lamp. Both its sides shine.
struct AreaPoint {
  Eigen::Vector3f position, normal;
  Eigen::Array3f power;  ///< radiance × area of the piece
  float area;
};

/// `count` points, each the middle of a piece of a lamp (colours: radiance); pieces have equal area times
/// brightness, are about as wide as long, and stay the same wherever a lamp goes. None where nothing shines.
std::vector<AreaPoint> area_points(const Mesh& lamps, int count);

}  // namespace refield::dynamic
