// SPDX-License-Identifier: Apache-2.0
#include "acquire/light_probe/mirror_ball.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "core/base/errors.h"

namespace refield {

namespace {

/// Solves 2β + δ(β) = γ. The left side grows steadily with β, so Newton's method converges.
double normal_angle(double gamma, double distance, double largest) {
  double beta = std::min(gamma / (2.0 + 1.0 / (distance - std::cos(gamma / 2.0))), largest);
  for (int i = 0; i < 30; ++i) {
    const double c = std::cos(beta), s = std::sqrt(std::max(0.0, 1.0 - c * c));  // 0 ≤ β < π/2
    const double value = 2.0 * beta + std::atan2(s, distance - c) - gamma;
    const double slope = 2.0 + (distance * c - 1.0) / (distance * distance - 2.0 * distance * c + 1.0);
    const double step = value / slope;
    beta = std::clamp(beta - step, 0.0, largest);
    if (std::abs(step) < 1e-10) break;  // it converges quadratically: the next step is below rounding
  }
  return beta;
}

}  // namespace

Eigen::Vector3d ProbeCamera::ray(const Eigen::Vector2d& point) const {
  const Eigen::Vector2d offset = (point - principal_px) / focal_px;
  return Eigen::Vector3d(offset.x(), -offset.y(), 1.0).normalized();
}

Eigen::Vector2d ProbeCamera::project(const Eigen::Vector3d& point) const {
  return principal_px + focal_px / point.z() * Eigen::Vector2d(point.x(), -point.y());
}

std::pair<Eigen::Vector3d, Eigen::Vector3d> tangents(const Eigen::Vector3d& axis) {
  const Eigen::Vector3d helper =
      std::abs(axis.y()) < 0.9 ? Eigen::Vector3d::UnitY() : Eigen::Vector3d::UnitX();
  const Eigen::Vector3d first = helper.cross(axis).normalized();
  return {first, axis.cross(first)};
}

MirrorBall::MirrorBall(const ProbeCamera& camera, const Eigen::Vector3d& towards, double distance_radii)
    : camera_(camera),
      towards_(towards.normalized()),
      distance_(distance_radii),
      half_angle_(std::asin(1.0 / distance_radii)) {
  if (!(distance_ > 1.0) || !std::isfinite(distance_))
    throw InputError("the camera is " + std::to_string(distance_) +
                     " ball radii from the ball's centre; it must be outside the ball, more than 1");
  // The whole outline must lie before the camera to have an image.
  if (!(towards_.z() > std::sin(half_angle_)))
    throw InputError("the ball is not in front of the camera; check the ball's place and the focal length");
}

std::optional<MirrorPoint> MirrorBall::reflect(const Eigen::Vector2d& point) const {
  const Eigen::Vector3d d = camera_.ray(point);
  // sin² of the angle to the axis by the cross product: the cosine would lose it for a ball far away.
  const double along = distance_ * d.dot(towards_);
  const double miss = distance_ * d.cross(towards_).norm();
  if (along <= 0.0 || miss >= 1.0) return std::nullopt;
  const double half_chord = std::sqrt((1.0 - miss) * (1.0 + miss));
  const Eigen::Vector3d normal = (along - half_chord) * d - distance_ * towards_;
  return MirrorPoint{(d + 2.0 * half_chord * normal).normalized(), half_chord};
}

std::optional<MirrorImage> MirrorBall::find(const Eigen::Vector3d& direction) const {
  const double gamma = std::atan2(direction.cross(towards_).norm(), -direction.dot(towards_));
  const double alpha = half_angle_;
  if (gamma >= std::numbers::pi - alpha) return std::nullopt;
  const double beta = normal_angle(gamma, distance_, std::numbers::pi / 2.0 - alpha);
  Eigen::Vector3d sideways = direction - direction.dot(towards_) * towards_;
  const double length = sideways.norm();
  sideways = length > 1e-12 ? Eigen::Vector3d(sideways / length) : tangents(towards_).first;
  const double c = std::cos(beta);
  const Eigen::Vector3d point = (distance_ - c) * towards_ + std::sin(beta) * sideways;
  const double range_squared = distance_ * distance_ - 2.0 * distance_ * c + 1.0;
  const double delta = std::atan2(std::sin(beta), distance_ - c);
  // dδ/dγ, the angle in the image for an angle outside, times pixels per radian in the image.
  const double delta_slope = (distance_ * c - 1.0) / range_squared;
  return MirrorImage{camera_.project(point), std::cos(beta + delta),
                     camera_.focal_px * delta_slope / (2.0 + delta_slope),
                     camera_.focal_px * (alpha - delta)};
}

double MirrorBall::radius_px() const {
  double sum = 0.0;
  constexpr int points = 64;
  const Eigen::Vector2d centre = centre_px();
  for (int i = 0; i < points; ++i)
    sum += (outline_point(2.0 * std::numbers::pi * i / points) - centre).norm();
  return sum / points;
}

Eigen::Vector2d MirrorBall::outline_point(double turn) const {
  const auto [first, second] = tangents(towards_);
  const double alpha = half_angle_;
  return camera_.project(std::cos(alpha) * towards_ +
                         std::sin(alpha) * (std::cos(turn) * first + std::sin(turn) * second));
}

}  // namespace refield
