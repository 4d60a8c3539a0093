// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/simulate/prt/path_comparison.h"
#include "tests/simulate/prt/small_scenes.h"

namespace refield::prt {
namespace {

constexpr float radius = 4.0f;

HarmonicTransfer transfer_of(const Scene& scene, const HarmonicOptions& options) {
  HarmonicStatistics statistics;
  return harmonic_transfer(scene, options, statistics);
}

/// A white square that reaches half way to the lights.
Scene ground_scene() {
  Scene scene;
  test::add(scene, plane_mesh(12), test::stretched(4.0f), {{1.0f, 1.0f, 1.0f}, {0.0f, 0.0f, 0.0f}, 0.0f});
  return scene;
}

/// Of the ground's vertices: error against a function of their distance from the middle, and the darkest
/// over the brightest.
struct GroundShading {
  double error, contrast;
};
template <class Expected>
GroundShading shade(const Scene& scene, const HarmonicTransfer& transfer, const test::HarmonicLight& light,
                    const Expected& expected) {
  test::RelativeError error;
  float low = 1e9f, high = 0.0f;
  for (std::size_t v = 0; v < scene.mesh.positions.size(); ++v) {
    const Eigen::Array3f seen = test::radiance(transfer, scene, light, v, Eigen::Vector3f::UnitY());
    error.add(seen, Eigen::Array3f::Constant(static_cast<float>(expected(scene.mesh.positions[v].norm()))));
    low = std::min(low, seen[0]);
    high = std::max(high, seen[0]);
  }
  return {error.value(), low / high};
}

/// Share of what leaves a small patch of ground that reaches a disc of radius a, parallel to it at height h,
/// whose axis is a distance d away (differential area to disc, Howell's catalogue B-13).
double form_factor(double h, double a, double d) {
  if (d == 0.0) return a * a / (h * h + a * a);
  const double height = h / d, size = a / d, z = 1.0 + height * height + size * size;
  return 0.5 * (1.0 - (z - 2.0 * size * size) / std::sqrt(z * z - 4.0 * size * size));
}

/// Figure 1. A cap of the sphere of lights above the ground gives each point what the disc across its rim
/// gives: both are of one radiance and within the same outline.
TEST(NearLight, ShadesTheGroundByTheFormFactorAndADistantOneFlat) {
  const Scene scene = ground_scene();
  constexpr double half_angle = 0.6;
  constexpr int order = 8;
  const test::HarmonicLight light = test::cap_light(Eigen::Vector3f::UnitY(), half_angle, order);
  const auto near = [&](double d) {
    return form_factor(radius * std::cos(half_angle), radius * std::sin(half_angle), d);
  };
  const HarmonicOptions options{.order = order, .radius = radius, .emission = Emission::from_surface};
  const GroundShading gradual = shade(scene, transfer_of(scene, options), light, near);
  const GroundShading flat = shade(scene, transfer_of(scene, {.order = order}), light,
                                   [](double) { return std::pow(std::sin(half_angle), 2); });
  EXPECT_LT(gradual.error, 0.02);
  EXPECT_LT(gradual.contrast, 0.7);
  EXPECT_LT(flat.error, 0.02);
  EXPECT_GT(flat.contrast, 0.999);
}

/// A small ball of radius a at distance d gives (a/d)² cos θ. Of such a light order 8 shows no more than
/// this.
TEST(NearLight, OfASmallBallFallsByTheSquare) {
  const Scene scene = ground_scene();
  constexpr int order = 8;
  constexpr double size = 0.2;
  const test::HarmonicLight light =
      test::cap_light(Eigen::Vector3f::UnitY(), std::asin(size / radius), order);
  const HarmonicOptions options{.order = order, .directions = 4096, .radius = radius};
  const GroundShading ball = shade(scene, transfer_of(scene, options), light, [](double d) {
    const double squared = radius * radius + d * d;
    return size * size / squared * radius / std::sqrt(squared);
  });
  EXPECT_LT(ball.error, 0.06);
}

TEST(NearLight, FarAwayIsDistant) {
  const Scene scene = test::ball_scene({});
  const HarmonicOptions near{.order = 4, .directions = 512, .until = 0.1, .radius = 2000.0};
  HarmonicOptions distant = near;
  distant.radius = 0.0;
  const HarmonicTransfer a = transfer_of(scene, near), b = transfer_of(scene, distant);
  double difference = 0.0, all = 0.0;
  for (std::size_t k = 0; k < a.values.size(); ++k) {
    difference += std::pow(a.values[k] - b.values[k], 2);
    all += std::pow(b.values[k], 2);
  }
  EXPECT_LT(std::sqrt(difference / all), 5e-3);  // rays that pass an edge closely
}

/// What paths that leave the scene find on the sphere of lights.
test::PathLight on_sphere(const test::HarmonicLight& light, const Eigen::Vector3f& centre,
                          Emission emission) {
  return
      [&light, centre, emission](const Eigen::Vector3f& at, const Eigen::Vector3f& from) -> Eigen::Array3f {
        const Eigen::Vector3f off = at - centre;
        const float along = off.dot(from);
        const float distance = std::sqrt(along * along + radius * radius - off.squaredNorm()) - along;
        const Eigen::Vector3f place = (off + distance * from) / radius;
        return emission == Emission::from_surface ? light(place) : light(place) / place.dot(from);
      };
}

TEST(NearLight, IsWhatTracedPathsSee) {
  const Material glossy = {{0.2f, 0.3f, 0.2f}, {0.5f, 0.5f, 0.4f}, 10.0f};
  const test::HarmonicLight light = test::random_harmonic_light(3, 4);
  for (const Emission emission : {Emission::towards_all, Emission::from_surface})
    for (const Material& ball : {Material{}, glossy}) {
      const Scene scene = test::ball_scene(ball);
      const HarmonicOptions options{
          .order = 5, .directions = 512, .until = 0.02, .radius = radius, .emission = emission};
      const auto traced = test::trace_vertices(scene, 53, on_sphere(light, middle(scene.mesh), emission),
                                               {.paths = 6000, .bounces = 7});
      const double error = test::error_of(transfer_of(scene, options), scene, light, traced);
      EXPECT_LT(error, 0.02);
    }
}

}  // namespace
}  // namespace refield::prt
