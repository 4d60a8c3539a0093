// SPDX-License-Identifier: Apache-2.0
#include "acquire/light_probe/judge.h"

#include <cmath>
#include <cstdio>
#include <numbers>

#include "acquire/light_probe/fill_unseen.h"
#include "core/errors.h"
#include "core/light_map.h"
#include "core/units.h"

namespace refield {

namespace {

constexpr double least_radius_px = 32.0;

double luminance(const float* rgb) {
  return 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
}

std::string per_cent(double fraction) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g %%", 100.0 * fraction);
  return text;
}

}  // namespace

void ProbeLimits::check() const {
  for (double fraction : {most_clipped, most_sun})
    if (!(fraction >= 0.0 && fraction <= 1.0))
      throw InputError("a limit of the light probe is " + std::to_string(fraction) +
                       "; give a fraction, 0 to 1");
  if (!(sun_degrees > 0.0 && sun_degrees <= 90.0))
    throw InputError("the sun's region is " + std::to_string(sun_degrees) +
                     " degrees; give more than 0, at most 90");
}

ProbeVerdict judge(const SeenLight& light, const ProbeLimits& limits) {
  const Image& map = light.radiance;
  std::size_t brightest = 0;
  for (std::size_t t = 0; t < map.pixel_count(); ++t)
    if (luminance(&map.values[3 * t]) > luminance(&map.values[3 * brightest])) brightest = t;
  const auto direction_of = [&](std::size_t t) {
    return lat_long_direction(static_cast<double>(t % map.width) + 0.5,
                              static_cast<double>(t / map.width) + 0.5, map.width, map.height);
  };
  const Eigen::Vector3d sun = direction_of(brightest);
  const double near = std::cos(radians_from_degrees(limits.sun_degrees));

  ProbeVerdict verdict;
  double all = 0.0, from_sun = 0.0, total = 0.0, clipped = 0.0;
  for (std::size_t t = 0; t < map.pixel_count(); ++t) {
    const double row = static_cast<double>(t / map.width) + 0.5;
    const double solid_angle = std::sin(std::numbers::pi * row / map.height);
    const double flux = solid_angle * luminance(&map.values[3 * t]);
    total += solid_angle;
    all += flux;
    if (direction_of(t).dot(sun) >= near) from_sun += flux;
    if (light.clipped[t]) clipped += solid_angle;
    for (int c = 0; c < 3; ++c) verdict.mean_radiance[c] += solid_angle * map.values[3 * t + c];
  }
  for (double& mean : verdict.mean_radiance) mean /= total;
  verdict.unseen_fraction = unseen_fraction(light.weight);
  verdict.clipped_fraction = clipped / total;
  verdict.sun_fraction = all > 0.0 ? from_sun / all : 0.0;

  if (!(all > 0.0))
    verdict.discarded = "it is black";
  else if (verdict.clipped_fraction > limits.most_clipped)
    verdict.discarded =
        "over-exposed: " + per_cent(verdict.clipped_fraction) +
        " of the sphere clipped in every exposure, so how bright it was (the sun?) is not known; "
        "add a shorter exposure or a denser filter";
  else if (verdict.sun_fraction > limits.most_sun)
    verdict.discarded = "sun only: " + per_cent(verdict.sun_fraction) + " of the light comes from one spot";
  return verdict;
}

void require_usable(const MirrorBall& ball, int width, int height, const std::string& name) {
  double beyond = 0.0;
  for (int i = 0; i < 360; ++i) {
    const Eigen::Vector2d p = ball.outline_point(2.0 * std::numbers::pi * i / 360.0);
    beyond = std::max({beyond, -p.x(), -p.y(), p.x() - width, p.y() - height});
  }
  if (beyond > 0.5)
    throw InputError(name + ": the ball reaches " + std::to_string(static_cast<int>(std::ceil(beyond))) +
                     " pixels beyond the photograph, so part of the environment is missing; photograph the "
                     "whole ball, or check --ball");
  if (ball.radius_px() < least_radius_px)
    throw InputError(name + ": the ball has a radius of " +
                     std::to_string(static_cast<int>(ball.radius_px())) +
                     " pixels, too few for a light map (at least " +
                     std::to_string(static_cast<int>(least_radius_px)) + "); use a longer lens or go nearer");
}

}  // namespace refield
