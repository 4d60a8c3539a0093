// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/placed_object.h"

namespace refield::dynamic {

SeenObject seen_object(const PlacedObject& object, const Pose& target) {
  const Pose from_target = object.pose.inverse() * target;
  const Eigen::Matrix3d rotation = from_target.linear().cast<double>();
  const Eigen::MatrixXf turn_back = harmonic_rotation(object.transport->order, rotation).cast<float>();
  return {object.transport, from_target, from_target.inverse().translation(), turn_back.transpose(),
          turn_back};
}

Harmonics covered_by(const SeenObject& object, const ShellGrid::Corners& corners) {
  const Eigen::MatrixXf& coverage = object.transport->coverage;
  Harmonics sum = Harmonics::Zero(coverage.rows());
  for (std::size_t i = 0; i < corners.point.size(); ++i)
    sum += corners.weight[i] * coverage.col(corners.point[i]);
  return object.turn * sum;
}

}  // namespace refield::dynamic
