// SPDX-License-Identifier: Apache-2.0
#include "tests/pipeline/mirror_ball_photo.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "core/light/light_map.h"

namespace refield {

namespace {

using Radiance = Eigen::Vector3d;

Radiance look_up(const Image& map, const Eigen::Vector3d& direction) {
  const Eigen::Vector2d p = lat_long_position(direction, map.width, map.height).array() - 0.5;
  const double fx = std::floor(p.x()), fy = std::floor(p.y());
  const double tx = p.x() - fx, ty = p.y() - fy;
  Radiance sum = Radiance::Zero();
  for (int k = 0; k < 4; ++k) {
    const int x = (static_cast<int>(fx) + (k & 1) + map.width) % map.width;
    const int y = std::clamp(static_cast<int>(fy) + (k >> 1), 0, map.height - 1);
    const double weight = ((k & 1) ? tx : 1.0 - tx) * ((k >> 1) ? ty : 1.0 - ty);
    sum += weight * Radiance(map.at(x, y, 0), map.at(x, y, 1), map.at(x, y, 2));
  }
  return sum;
}

/// Unpolarised reflectance of a conductor in air, by the complex amplitudes.
double fresnel(std::complex<double> index, double cos_incidence) {
  const std::complex<double> sine = std::sqrt(1.0 - cos_incidence * cos_incidence) / index;
  const std::complex<double> cosine = std::sqrt(1.0 - sine * sine);
  const auto across = (cos_incidence - index * cosine) / (cos_incidence + index * cosine);
  const auto along = (index * cos_incidence - cosine) / (index * cos_incidence + cosine);
  return 0.5 * (std::norm(across) + std::norm(along));
}

Radiance trace(const Image& environment, const MirrorBallScene& scene, double px, double py) {
  const Eigen::Vector3d ray = Eigen::Vector3d((px - 0.5 * scene.width) / scene.focal_px,
                                              (0.5 * scene.height - py) / scene.focal_px, 1.0)
                                  .normalized();
  const double along = ray.dot(scene.ball_centre);
  const double discriminant = along * along - scene.ball_centre.squaredNorm() + 1.0;
  if (discriminant <= 0.0)
    return scene.backdrop ? Radiance(scene.backdrop->cast<double>())
                          : look_up(environment, scene.world_from_camera * ray);
  const Eigen::Vector3d normal = ray * (along - std::sqrt(discriminant)) - scene.ball_centre;
  const double cos_incidence = -ray.dot(normal);
  Radiance light = look_up(environment, scene.world_from_camera * (ray + 2.0 * cos_incidence * normal));
  if (scene.refractive_index)
    for (int c = 0; c < 3; ++c) light[c] *= fresnel((*scene.refractive_index)[c], cos_incidence);
  return light;
}

/// Whether the ball's outline may pass through a pixel's neighbourhood, where radiance changes fast.
bool near_outline(const MirrorBallScene& scene, double px, double py) {
  const Eigen::Vector3d ray((px - 0.5 * scene.width) / scene.focal_px,
                            (0.5 * scene.height - py) / scene.focal_px, 1.0);
  const double angle = std::atan2(ray.cross(scene.ball_centre).norm(), ray.dot(scene.ball_centre));
  const double outline = std::asin(1.0 / scene.ball_centre.norm());
  return std::abs(angle - outline) * scene.focal_px < 4.0;
}

}  // namespace

Image photograph_mirror_ball(const Image& environment, const MirrorBallScene& scene) {
  Image photograph(scene.width, scene.height, 3);
  tbb::parallel_for(tbb::blocked_range<int>(0, scene.height, 8), [&](const tbb::blocked_range<int>& rows) {
    for (int y = rows.begin(); y < rows.end(); ++y)
      for (int x = 0; x < scene.width; ++x) {
        const int n = near_outline(scene, x + 0.5, y + 0.5) ? 4 * scene.samples : scene.samples;
        Radiance sum = Radiance::Zero();
        for (int j = 0; j < n; ++j)
          for (int i = 0; i < n; ++i) sum += trace(environment, scene, x + (i + 0.5) / n, y + (j + 0.5) / n);
        for (int c = 0; c < 3; ++c) photograph.at(x, y, c) = static_cast<float>(sum[c] / (n * n));
      }
  });
  return photograph;
}

}  // namespace refield
