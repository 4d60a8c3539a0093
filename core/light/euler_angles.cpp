// SPDX-License-Identifier: Apache-2.0
#include "core/light/euler_angles.h"

#include <Eigen/Geometry>
#include <cmath>

#include "core/base/units.h"

namespace refield {

Eigen::Matrix3d EulerAngles::matrix() const {
  return (Eigen::AngleAxisd(radians_from_degrees(yaw), Eigen::Vector3d::UnitY()) *
          Eigen::AngleAxisd(radians_from_degrees(pitch), Eigen::Vector3d::UnitX()) *
          Eigen::AngleAxisd(radians_from_degrees(roll), Eigen::Vector3d::UnitZ()))
      .toRotationMatrix();
}

bool EulerAngles::is_none() const {
  return std::fmod(yaw, 360.0) == 0.0 && std::fmod(pitch, 360.0) == 0.0 && std::fmod(roll, 360.0) == 0.0;
}

}  // namespace refield
