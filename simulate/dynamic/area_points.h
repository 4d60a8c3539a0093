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

/// `count` points spread over lamps (colours: radiance) in proportion to area times brightness, the same ones
/// of a lamp wherever it is. None where nothing shines.
std::vector<AreaPoint> area_points(const Mesh& lamps, int count);

}  // namespace refield::dynamic
