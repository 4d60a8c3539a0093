// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <optional>
#include <span>
#include <vector>

#include "acquire/light_probe/mirror_ball.h"
#include "core/image/image.h"
#include "core/image/metrics.h"

namespace refield {

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

/// The ball whose outline is the border of a painted mask [height × width] that is non-zero on the ball. The
/// mask's border against the edge of the image does not count. Throws InputError when the mask is empty or
/// shows no round shape.
MirrorBall ball_from_mask(const Mask& mask, int width, int height, const ProbeOptics& optics);

/// Finds a mirror ball in a photograph: circles are proposed by the Hough transform of the edges of its
/// logarithm, each is refined to a fraction of a pixel by the sharpest step along 720 radii, and the one
/// whose outline is clearest is taken. The background is best plain and unlike the ball's rim: a mirror ball
/// before distant environment has hardly an outline, since its rim shows what is just beside it. Throws
/// InputError when there is no clear ball; the message says what to do.
OutlineFit find_ball(const Image& photograph, const ProbeOptics& optics);

}  // namespace refield
