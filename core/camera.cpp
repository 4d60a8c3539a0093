// SPDX-License-Identifier: Apache-2.0
#include "core/camera.h"

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <string>

#include "core/errors.h"

namespace refield {

Eigen::Vector3f PinholeCamera::direction(float x, float y) const {
  const Eigen::Vector3f ahead = (target - position).normalized();
  const Eigen::Vector3f right = up.cross(ahead).normalized();
  const Eigen::Vector3f above = ahead.cross(right);
  const float half_height =
      std::tan(0.5f * vertical_field_of_view_degrees * std::numbers::pi_v<float> / 180.0f);
  const auto h = static_cast<float>(height), w = static_cast<float>(width);
  return (ahead + half_height * ((2.0f * x - w) / h * right + (1.0f - 2.0f * y / h) * above)).normalized();
}

void PinholeCamera::check() const {
  if (width <= 0 || height <= 0)
    throw InputError("the camera's image is " + std::to_string(width) + "×" + std::to_string(height) +
                     " pixels; give a size above zero");
  if (!(vertical_field_of_view_degrees > 0.0f && vertical_field_of_view_degrees < 180.0f))
    throw InputError("the camera's field of view is " + std::to_string(vertical_field_of_view_degrees) +
                     " degrees; give one between 0 and 180");
  const Eigen::Vector3f ahead = target - position;
  const float sine = up.cross(ahead).norm();
  if (!ahead.allFinite() || !up.allFinite() || !(sine > 1e-6f * up.norm() * ahead.norm()))
    throw InputError("the camera looks along its up direction or nowhere; give another target or up");
}

}  // namespace refield
