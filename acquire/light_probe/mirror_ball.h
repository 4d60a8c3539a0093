// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>

#include "core/image/metrics.h"

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

/// A circle in the image, pixels.
struct ImageCircle {
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  double radius = 0.0;
};

/// What is known of the camera; just one of the two is needed, since the ball's size in the image gives the
/// other.
struct ProbeOptics {
  std::optional<double> focal_px;        ///< focal length in pixels
  std::optional<double> distance_radii;  ///< from the camera to the ball's centre, in radii of the ball
  Eigen::Vector2d principal_px = Eigen::Vector2d::Zero();  ///< usually the middle of the image

  /// Of a photograph that shows `degrees` across its width.
  static ProbeOptics of_view(double degrees, int width, int height);

  /// Throws InputError unless exactly one is given and it is in range.
  void check() const;
};

/// How well points fit an outline.
struct OutlineFit {
  MirrorBall ball;
  double support = 0.0;  ///< fraction of the points within 1.5 pixels of the outline
  double rms_px = 0.0;   ///< of those points
};

/// Fits a ball to points of its outline, which is the image of a circular cone of rays: off the optical axis
/// an ellipse. Least squares of the distance in pixels, with Tukey's weights, so that up to about half of the
/// points may lie elsewhere; `start` must be near. Throws InputError for fewer than eight points or when no
/// ball fits.
OutlineFit fit_outline(std::span<const Eigen::Vector2d> points, const ProbeOptics& optics,
                       const ImageCircle& start);

/// The ball whose outline comes nearest to a circle that was drawn around it.
MirrorBall ball_from_circle(const ImageCircle& circle, const ProbeOptics& optics);

/// Finds a mirror ball in a photograph: circles are proposed by the Hough transform of the edges of its
/// logarithm, each is refined to a fraction of a pixel by the sharpest step along 720 radii, and the one
/// whose outline is clearest is taken. The background is best plain and unlike the ball's rim: a mirror ball
/// before distant environment has hardly an outline, since its rim shows what is just beside it. Throws
/// InputError when there is no clear ball; the message says what to do.
OutlineFit find_ball(const Image& photograph, const ProbeOptics& optics);

}  // namespace refield
