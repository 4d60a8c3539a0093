// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>

#include "acquire/light_probe/mirror_ball.h"
#include "core/light/monitor_placement.h"

namespace refield {

/// Where a light map is bright, as (u, v) from 0 to 1 across and down the screen; nullopt where that is more
/// than a spot of a twentieth of the map, or dark.
std::optional<Eigen::Vector2d> spot_of(const Image& light);

/// Centroid in pixels of the brightest reflection in a ball; nullopt where the photograph is dark there.
std::optional<Eigen::Vector2d> highlight_in(const Image& photograph, const MirrorBall& ball);

/// A spot on the screen and its reflection in the photograph.
struct SpotReflection {
  Eigen::Vector2d screen;    ///< (u, v), see MonitorPlacement::direction()
  Eigen::Vector2d image_px;  ///< y down, pixel centres at +0.5
};

/// The ball that stands where the scene will.
struct ReferenceBall {
  MirrorBall ball;  ///< as the camera sees it
  double diameter_mm = 0.0;
  double outline_sigma_px = 0.3;  ///< standard deviation of its centre and radius in the photograph
};

struct MonitorSighting {
  MonitorPlacement placement;  ///< about the centre of the ball, in the axes of the camera
  /// Top left, top right, bottom right, bottom left of the screen as seen from the ball, from its centre, in
  /// the axes of the camera.
  std::array<Eigen::Vector3d, 4> corners_mm;
  /// Standard deviation of a corner's position, the largest of the four, relative to its distance: from the
  /// scatter of the spots and the ball's outline. Wrong lengths and fields of view are not in it.
  double corner_sigma = 0.0;
  double rms_px = 0.0;                ///< between spots and their predicted reflections
  std::vector<std::size_t> left_out;  ///< spots whose reflection is elsewhere
};

/// The screen of the given size whose spots are reflected where they are seen. The reflections give
/// directions, these the homography of the plane, and that the start of a least-squares fit of the
/// reflections on a ball of finite size, over the screen's pose and, within their uncertainty, the ball's
/// place and distance. Throws InputError for fewer than 6 spots that fit, or a screen that faces away.
MonitorSighting place_monitor(std::span<const SpotReflection> spots, const ReferenceBall& reference,
                              double width_mm, double height_mm);

}  // namespace refield
