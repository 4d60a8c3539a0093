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

}  // namespace refield::dynamic
