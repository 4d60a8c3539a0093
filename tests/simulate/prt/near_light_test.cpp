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

TEST(NearLight, ADistantOneShadesTheGroundFlat) {
  const Scene scene = ground_scene();
  constexpr double half_angle = 0.6;
  constexpr int order = 8;
  const test::HarmonicLight light = test::cap_light(Eigen::Vector3f::UnitY(), half_angle, order);
  const GroundShading flat = shade(scene, transfer_of(scene, {.order = order}), light,
                                   [](double) { return std::pow(std::sin(half_angle), 2); });
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
test::PathLight on_sphere(const test::HarmonicLight& light, const Eigen::Vector3f& centre) {
  return [&light, centre](const Eigen::Vector3f& at, const Eigen::Vector3f& from) -> Eigen::Array3f {
    const Eigen::Vector3f off = at - centre;
    const float along = off.dot(from);
    const float distance = std::sqrt(along * along + radius * radius - off.squaredNorm()) - along;
    const Eigen::Vector3f place = (off + distance * from) / radius;
    return light(place) / place.dot(from);
  };
}

TEST(NearLight, IsWhatTracedPathsSee) {
  const Material glossy = {{0.2f, 0.3f, 0.2f}, {0.5f, 0.5f, 0.4f}, 10.0f};
  const test::HarmonicLight light = test::random_harmonic_light(3, 4);
  for (const Material& ball : {Material{}, glossy}) {
    const Scene scene = test::ball_scene(ball);
    const HarmonicOptions options{.order = 5, .directions = 512, .until = 0.02, .radius = radius};
    const auto traced =
        test::trace_vertices(scene, 53, on_sphere(light, middle(scene.mesh)), {.paths = 6000, .bounces = 7});
    EXPECT_LT(test::error_of(transfer_of(scene, options), scene, light, traced), 0.02);
  }
}

}  // namespace
}  // namespace refield::prt
