// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <optional>
#include <utility>

namespace refield {

/// A pinhole camera before a ball. Camera axes: x to the right, y up, z forward, as someone behind the camera
/// sees them. Image points are in pixels, y down, pixel centres at +0.5.
struct ProbeCamera {
  double focal_px = 0.0;  ///< focal length in pixels
  Eigen::Vector2d principal_px = Eigen::Vector2d::Zero();

  /// Unit direction in which the camera sees an image point.
  Eigen::Vector3d ray(const Eigen::Vector2d& point) const;
  /// Image of a point in front of the camera (z > 0), camera axes.
  Eigen::Vector2d project(const Eigen::Vector3d& point) const;
};

/// Where an image point on the ball gets its light from.
struct MirrorPoint {
  Eigen::Vector3d direction;  ///< unit, camera axes: the light comes from there
  double cos_incidence = 0.0;
};

/// The image point that shows a direction.
struct MirrorImage {
  Eigen::Vector2d point;  ///< pixels
  double cos_incidence = 0.0;
  /// Pixels that a radian spans across the direction of compression: near the outline the environment is
  /// squeezed radially, and this falls to zero.
  double pixels_per_radian = 0.0;
  double depth_px = 0.0;  ///< inside the outline by that many pixels
};

/// A mirror sphere as a camera sees it, its radius the unit of length. Light is taken to come from far away:
/// the direction decides, not the place on the ball.
///
/// With the ball's centre at distance D from the camera, a point whose normal makes the angle β with the way
/// back to the camera shows the direction at the angle 2β + δ(β) from that way, tan δ = sin β / (D − cos β);
/// at the outline β + δ = 90°. So directions within α = asin(1/D) of straight behind the ball are not seen.
class MirrorBall {
 public:
  /// `towards`: unit direction from the camera to the ball's centre. Throws InputError unless the ball lies
  /// before the camera and the camera outside the ball.
  MirrorBall(const ProbeCamera& camera, const Eigen::Vector3d& towards, double distance_radii);

  const ProbeCamera& camera() const { return camera_; }
  const Eigen::Vector3d& towards() const { return towards_; }
  double distance_radii() const { return distance_; }
  /// Half the angle under which the camera sees the ball; also of the cone behind it that nothing shows.
  double half_angle() const { return half_angle_; }

  /// nullopt beside the ball.
  std::optional<MirrorPoint> reflect(const Eigen::Vector2d& point) const;
  /// nullopt in the cone behind the ball. `direction`: unit, camera axes.
  std::optional<MirrorImage> find(const Eigen::Vector3d& direction) const;

  /// The outline's centre (image of the cone's axis) and mean radius in the image, pixels.
  Eigen::Vector2d centre_px() const { return camera_.project(towards_); }
  double radius_px() const;
  /// A point of the outline, at the angle `turn` (radians) about the centre.
  Eigen::Vector2d outline_point(double turn) const;

 private:
  ProbeCamera camera_;
  Eigen::Vector3d towards_;
  double distance_;
  double half_angle_;
};

/// Two unit vectors that complete a unit vector to a right-handed orthonormal frame.
std::pair<Eigen::Vector3d, Eigen::Vector3d> tangents(const Eigen::Vector3d& axis);

}  // namespace refield
