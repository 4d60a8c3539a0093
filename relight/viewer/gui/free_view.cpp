// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/gui/free_view.h"

#include <Eigen/Geometry>

#include <cmath>
#include <numbers>

#include "core/base/number_text.h"

namespace refield {

namespace {
constexpr double radians = std::numbers::pi / 180.0;
}

OrbitCamera::OrbitCamera(const PinholeCamera& start) : start_(start), camera_(start) {}

void OrbitCamera::set_size(int width, int height) {
  for (PinholeCamera* camera : {&start_, &camera_}) {
    camera->width = width;
    camera->height = height;
  }
}

void OrbitCamera::orbit(double right_degrees, double up_degrees) {
  constexpr double steepest = 89.0 * radians;
  const Eigen::Vector3d offset = (camera_.position - camera_.target).cast<double>();
  const double length = offset.norm();
  // Seen from above, going to the camera's right is going from −Z to +X.
  const double around = std::atan2(offset.x(), -offset.z()) + right_degrees * radians;
  const double height = std::clamp(
      std::asin(std::clamp(offset.y() / length, -1.0, 1.0)) + up_degrees * radians, -steepest, steepest);
  const Eigen::Vector3d direction(std::cos(height) * std::sin(around), std::sin(height),
                                  -std::cos(height) * std::cos(around));
  camera_.position = camera_.target + (length * direction).cast<float>();
  camera_.up = Eigen::Vector3f::UnitY();
}

void OrbitCamera::approach(double factor) {
  const double first = (start_.position - start_.target).cast<double>().norm();
  const double wanted = std::clamp(distance() / factor, 1e-3 * first, 1e3 * first);
  const Eigen::Vector3f direction = (camera_.position - camera_.target).normalized();
  camera_.position = camera_.target + static_cast<float>(wanted) * direction;
}

void OrbitCamera::pan(double right_px, double down_px) {
  const Eigen::Matrix3f axes = camera_.axes();
  const double per_pixel =
      2.0 * distance() * std::tan(0.5 * camera_.vertical_field_of_view_degrees * radians) / camera_.height;
  const Eigen::Vector3f shift =
      axes.transpose() * Eigen::Vector3d(-right_px * per_pixel, down_px * per_pixel, 0.0).cast<float>();
  camera_.position += shift;
  camera_.target += shift;
}

void OrbitCamera::reset() {
  camera_ = start_;
}

FreeView::FreeView(const FieldOutline& field)
    : FreeView(standard_camera(field), [&field](const PinholeCamera& camera, int samples) {
        return std::make_unique<const MeshRenderer>(field, camera, samples);
      }) {}

FreeView::FreeView(const PinholeCamera& start, Look look) : look_(std::move(look)), orbit_(start) {
  update();
}

OrbitCamera& FreeView::move() {
  is_moved_ = true;
  return orbit_;
}

bool FreeView::update(Clock::time_point now) {
  const bool rests = is_settled_ || (!is_moved_ && is_rough_ && now - moved_at_ >= rest);
  if (!rests && !is_moved_) return false;
  view_ = look_(camera(), rests ? 4 : 1);
  if (is_moved_) moved_at_ = now;
  is_moved_ = is_settled_ = false;
  is_rough_ = !rests;
  return true;
}

}  // namespace refield
