// SPDX-License-Identifier: Apache-2.0
#include "acquire/import/chrome_ball.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "acquire/light_probe/light_probe.h"
#include "core/base/errors.h"
#include "core/base/units.h"

namespace refield {

namespace {

/// Rays of a camera at this distance, in radii of the ball, are parallel.
constexpr double far_away = 1e4;
/// The outermost pixels show light from behind the ball, and are partly the background.
constexpr double ball_rim_px = 1.0;

std::string position_text(const Eigen::Vector2d& point) {
  return std::to_string(std::lround(point.x())) + "," + std::to_string(std::lround(point.y()));
}

/// Brightness of the pixels on the ball, zero elsewhere.
cv::Mat1f brightness_on(const MirrorBall& ball, const Image& photograph) {
  cv::Mat1f brightness = cv::Mat1f::zeros(photograph.height, photograph.width);
  const Eigen::Vector2d centre = ball.centre_px();
  const double radius = ball.radius_px() - ball_rim_px;
  const int first = std::max(0, static_cast<int>(centre.y() - radius));
  const int last = std::min(photograph.height, static_cast<int>(centre.y() + radius) + 1);
  for (int y = first; y < last; ++y)
    for (int x = 0; x < photograph.width; ++x) {
      if ((Eigen::Vector2d(x + 0.5, y + 0.5) - centre).norm() > radius) continue;
      const float value = (photograph.at(x, y, 0) + photograph.at(x, y, 1) + photograph.at(x, y, 2)) / 3.0f;
      brightness(y, x) = std::max(value, 1e-30f);  // negative after subtraction of the ambient light
    }
  return brightness;
}

}  // namespace

MirrorBall locate_ball(const ChromeBall& ball, const Image& mean) {
  ProbeOptics optics;
  optics.principal_px = Eigen::Vector2d(mean.width, mean.height) / 2.0;
  if (ball.field_of_view_degrees) {
    const double view = *ball.field_of_view_degrees;
    if (!(view > 0.0 && view < 180.0))
      throw InputError("--field-of-view " + std::to_string(view) +
                       ": give more than 0, less than 180 degrees");
    optics.focal_px = 0.5 * mean.width / std::tan(radians_from_degrees(view) / 2.0);
  } else {
    optics.distance_radii = far_away;
  }
  MirrorBall located = ball.circle ? ball_from_circle(*ball.circle, optics) : find_ball(mean, optics).ball;
  require_usable(located, mean.width, mean.height, "the photographs");
  return located;
}

Eigen::Vector3d light_direction(const Image& photograph, const MirrorBall& ball) {
  const cv::Mat1f brightness = brightness_on(ball, photograph);
  std::vector<float> values;
  for (const float value : brightness)
    if (value > 0.0f) values.push_back(value);
  const auto largest = static_cast<float>(quantile(values, 1.0));
  const auto room = static_cast<float>(quantile(values, 0.5));
  constexpr float least_contrast = 3.0f;
  if (!(largest > least_contrast * room))
    throw InputError("the ball at " + position_text(ball.centre_px()) +
                     " shows no highlight; check --ball, or leave the photograph out");
  cv::Mat1b bright = (brightness > 0.25f * largest) / 255;
  // A small highlight is partly in the pixels around it.
  cv::dilate(bright, bright, {});
  cv::Mat1i label;
  const int count = cv::connectedComponents(bright, label, 8, CV_32S);
  std::vector<double> total(static_cast<std::size_t>(count), 0.0);
  std::vector<Eigen::Vector2d> centroid(total.size(), Eigen::Vector2d::Zero());
  for (int y = 0; y < label.rows; ++y)
    for (int x = 0; x < label.cols; ++x) {
      const auto region = static_cast<std::size_t>(label(y, x));
      const double excess = brightness(y, x) - room;
      if (region == 0 || !(excess > 0.0)) continue;
      total[region] += excess;
      centroid[region] += excess * Eigen::Vector2d(x + 0.5, y + 0.5);
    }
  for (std::size_t region = 1; region < total.size(); ++region) centroid[region] /= total[region];
  const auto brightest = static_cast<std::size_t>(std::ranges::max_element(total) - total.begin());
  constexpr double similar = 0.3;  // windows and reflections in the object are weaker
  for (std::size_t region = 1; region < total.size(); ++region)
    if (region != brightest && total[region] > similar * total[brightest])
      throw InputError("the ball shows two highlights, at " + position_text(centroid[brightest]) + " and " +
                       position_text(centroid[region]) +
                       "; photograph under one light source at a time, subtract the ambient light "
                       "(--ambient), or leave the photograph out");
  return ball.reflect(centroid[brightest])->direction;
}

void exclude_ball(Mask& mask, int width, int height, const MirrorBall& ball) {
  constexpr double border_px = 2.0;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      if ((Eigen::Vector2d(x + 0.5, y + 0.5) - ball.centre_px()).norm() < ball.radius_px() + border_px)
        mask[static_cast<std::size_t>(y) * width + x] = 0;
}

}  // namespace refield
