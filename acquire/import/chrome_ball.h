// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <optional>

#include "acquire/light_probe/mirror_ball.h"
#include "core/image/image.h"
#include "core/image/metrics.h"

namespace refield {

/// A mirror ball beside the object, in the photographs of a light stage.
struct ChromeBall {
  std::optional<ImageCircle> circle;            ///< nullopt: it is found in the mean photograph
  std::optional<double> field_of_view_degrees;  ///< across the photograph's width; nullopt: far camera
};

/// The ball in `mean`, the mean of the photographs under all light sources. With a far camera, directions are
/// relative to that from the ball to the camera, instead of the optical axis. Throws InputError where the
/// ball is not found, or not whole.
MirrorBall locate_ball(const ChromeBall& ball, const Image& mean);

/// Direction towards the light source, unit length, in the axes of lat-long maps, from the highlight on the
/// ball: the centroid of the samples above a quarter of the largest, and those around them. Source: RTI
/// practice, for instance Mudge et al. 2006. The source is taken to be far away: at a distance of d radii of
/// the ball, its direction from the ball's centre differs by up to 1/d. Throws InputError where there is no
/// single highlight.
Eigen::Vector3d light_direction(const Image& photograph, const MirrorBall& ball);

/// Excludes the ball and a border of two pixels from a mask [height × width].
void exclude_ball(Mask& mask, int width, int height, const MirrorBall& ball);

}  // namespace refield
