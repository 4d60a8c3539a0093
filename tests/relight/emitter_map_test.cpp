// SPDX-License-Identifier: Apache-2.0
#include "relight/mesh/mesh_view.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include "core/light/cube_map.h"

namespace refield {
namespace {

constexpr int resolution = 32;

/// A flat disc of many corners that faces the origin.
Mesh disc(const Eigen::Vector3f& middle, float radius, const Eigen::Array3f& radiance) {
  constexpr std::uint32_t corners = 64;
  const Eigen::Vector3f side = middle.unitOrthogonal(), up = middle.normalized().cross(side);
  Mesh mesh;
  mesh.positions = {middle};
  for (std::uint32_t k = 0; k < corners; ++k) {
    const float angle = 2.0f * std::numbers::pi_v<float> * static_cast<float>(k) / corners;
    mesh.positions.push_back(middle + radius * (std::cos(angle) * side + std::sin(angle) * up));
    mesh.triangles.push_back({0, k + 1, (k + 1) % corners + 1});
  }
  mesh.normals.assign(mesh.positions.size(), -middle.normalized());
  mesh.colours.assign(mesh.positions.size(), radiance);
  return mesh;
}

void append(Mesh& mesh, const Mesh& more) {
  const auto first = static_cast<std::uint32_t>(mesh.positions.size());
  mesh.positions.insert(mesh.positions.end(), more.positions.begin(), more.positions.end());
  mesh.colours.insert(mesh.colours.end(), more.colours.begin(), more.colours.end());
  for (const auto& [a, b, c] : more.triangles) mesh.triangles.push_back({first + a, first + b, first + c});
}

/// ∫ L dω, and ∫ L ω dω.
struct Moments {
  Eigen::Array3d power = Eigen::Array3d::Zero();
  Eigen::Vector3d flow = Eigen::Vector3d::Zero();  // of the first channel
};
Moments moments_of(const LightMap& map) {
  Moments moments;
  for (int y = 0; y < map.radiance.height; ++y)
    for (int x = 0; x < resolution; ++x) {
      const double angle = cube_solid_angle(x, y, resolution);
      for (int c = 0; c < 3; ++c) moments.power[c] += angle * map.radiance.at(x, y, c);
      moments.flow += angle * map.radiance.at(x, y, 0) * cube_direction(x + 0.5, y + 0.5, resolution);
    }
  return moments;
}

TEST(EmitterMap, HoldsTheSolidAngleOfLightsWhereverTheyStand) {
  constexpr float radius = 0.5f;
  for (int k = 0; k < 40; ++k) {
    const auto turn = static_cast<float>(k);
    const Eigen::Vector3f place =
        3.0f *
        Eigen::Vector3f(std::sin(turn), std::cos(1.7f * turn), std::sin(0.6f * turn + 1.0f)).normalized();
    const Moments moments =
        moments_of(emitter_map(disc(place, radius, {2.0f, 1.0f, 0.0f}), {0, 0, 0}, resolution));
    const double expected = 2.0 * std::numbers::pi * (1.0 - 3.0 / std::hypot(3.0, radius));
    EXPECT_NEAR(moments.power[0], 2.0 * expected, 0.01 * expected) << place.transpose();
    EXPECT_NEAR(moments.power[1], expected, 0.005 * expected);
    EXPECT_EQ(moments.power[2], 0.0);
    EXPECT_GT(moments.flow.normalized().dot(place.cast<double>().normalized()), 0.9999);
  }
}

TEST(EmitterMap, NearerLightsHideOthersAndTheViewIsFromTheMiddle) {
  const Eigen::Vector3f middle(1.0f, -2.0f, 0.5f);
  const auto lights = [&](float red_distance, float green_distance) {
    Mesh mesh = disc({0.0f, red_distance, 0.0f}, 0.3f * red_distance, {1.0f, 0.0f, 0.0f});
    append(mesh, disc({0.0f, green_distance, 0.0f}, 0.3f * green_distance, {0.0f, 1.0f, 0.0f}));
    for (auto& position : mesh.positions) position += middle;
    return moments_of(emitter_map(mesh, middle, resolution)).power;
  };
  EXPECT_EQ(lights(1.0f, 2.0f)[1], 0.0);
  EXPECT_GT(lights(1.0f, 2.0f)[0], 0.2);
  EXPECT_EQ(lights(2.0f, 1.0f)[0], 0.0);
}

/// Section 3.2 weighs pixels by ∆A ∕ √(x² + y² + 1), ∆A = 4π ∕ N.
TEST(EmitterMap, ThePapersWeightOfPixelsIsAnApproximation) {
  const auto papers_weight = [](int x, int y) {
    const Eigen::Vector3d direction = cube_direction(x + 0.5, y + 0.5, resolution);
    return direction.cwiseAbs().maxCoeff() * 4.0 * std::numbers::pi / (6.0 * resolution * resolution);
  };
  double sphere = 0.0;
  for (int y = 0; y < resolution; ++y)
    for (int x = 0; x < resolution; ++x) sphere += 6.0 * papers_weight(x, y);
  EXPECT_NEAR(sphere / (4.0 * std::numbers::pi), 0.79, 0.01);
  const int middle = resolution / 2;
  EXPECT_NEAR(papers_weight(middle, middle) / cube_solid_angle(middle, middle, resolution), 0.52, 0.01);
  EXPECT_NEAR(papers_weight(0, 0) / cube_solid_angle(0, 0, resolution), 1.5, 0.1);
}

}  // namespace
}  // namespace refield
