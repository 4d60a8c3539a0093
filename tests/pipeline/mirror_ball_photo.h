// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <array>
#include <complex>
#include <optional>

#include "core/image/image.h"

namespace refield {

/// A mirror ball before a pinhole camera, in distant environment. Camera axes: x right, y up, z forward;
/// the ball's radius is the unit of length.
struct MirrorBallScene {
  int width = 512;
  int height = 512;
  double focal_px = 2000.0;
  Eigen::Vector3d ball_centre = {0.0, 0.0, 10.0};
  Eigen::Matrix3d world_from_camera = Eigen::Matrix3d::Identity();
  /// Of the mirror, n + ik for red, green and blue; nullopt: reflects everything.
  std::optional<std::array<std::complex<double>, 3>> refractive_index;
  /// What is seen beside the ball; nullopt: the environment themselves.
  std::optional<Eigen::Vector3f> backdrop;
  int samples = 6;  ///< along each side of a pixel; four times as many at the ball's outline
};

/// The photograph, scene-linear: each pixel the mean over its square of what rays see, reflected once by the
/// ball by Fresnel's equations. `environment`: lat-long, interpolated bilinearly, directions as in
/// lat_long_direction().
Image photograph_mirror_ball(const Image& environment, const MirrorBallScene& scene);

}  // namespace refield
