// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/dynamic_light.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "simulate/geometry/mesh_shapes.h"

namespace refield::dynamic {
namespace {

Mesh area_light(float radiance, const Eigen::Vector3f& position) {
  Mesh mesh = prt::plane_mesh(2);
  for (auto& colour : mesh.colours) colour = {radiance, 0.5f * radiance, 0.0f};
  for (auto& point : mesh.positions) point += position;
  return mesh;
}

TEST(AreaPoints, TogetherHaveThePowerOfTheAreaLight) {
  for (const int count : {1, 3, 16, 100}) {
    Eigen::Array3f power = Eigen::Array3f::Zero();
    Eigen::Vector3f middle = Eigen::Vector3f::Zero();
    for (const AreaPoint& point : area_points(area_light(2.0f, {0, 0, 0}), count)) {
      power += point.power;
      middle += point.position / static_cast<float>(count);
    }
    EXPECT_NEAR(power[0], 2.0f, 1e-4f) << count;
    EXPECT_NEAR(power[1], 1.0f, 1e-4f) << count;
    EXPECT_EQ(power[2], 0.0f);
    EXPECT_LT(middle.norm(), count == 1 ? 0.01f : 0.02f) << count;
  }
}

TEST(AreaPoints, GoWhereMostLightIs) {
  Mesh both = area_light(9.0f, {-2, 0, 0});
  const Mesh weak = area_light(1.0f, {2, 0, 0});
  const auto first = static_cast<std::uint32_t>(both.positions.size());
  both.positions.insert(both.positions.end(), weak.positions.begin(), weak.positions.end());
  both.colours.insert(both.colours.end(), weak.colours.begin(), weak.colours.end());
  for (const auto& [a, b, c] : weak.triangles) both.triangles.push_back({first + a, first + b, first + c});
  int strong = 0;
  for (const AreaPoint& point : area_points(both, 100)) strong += point.position.x() < 0.0f;
  EXPECT_EQ(strong, 90);
}

TEST(AreaPoints, AreMiddlesOfCellsAndGoWithTheAreaLight) {
  const auto points = area_points(area_light(1.0f, {0, 0, 0}), 16);
  ASSERT_EQ(points.size(), 16u);
  for (const AreaPoint& point : points) {
    // 4 × 4 cells of a quarter
    const auto from_middle = [](float x) { return std::abs(std::remainder(4.0f * x + 0.5f, 1.0f)); };
    EXPECT_LT(from_middle(point.position.x()), 0.15f) << point.position.transpose();
    EXPECT_LT(from_middle(point.position.z()), 0.15f) << point.position.transpose();
  }
  Mesh turned = area_light(1.0f, {0, 0, 0});
  Eigen::Isometry3f pose =
      Eigen::Translation3f(1, 2, 3) * Eigen::AngleAxisf(0.7f, Eigen::Vector3f(1, 2, 1).normalized());
  for (auto& point : turned.positions) point = pose * point;
  const auto moved = area_points(turned, 16);
  for (std::size_t i = 0; i < 16; ++i)
    EXPECT_LT((moved[i].position - pose * points[i].position).norm(), 0.03f);
}

TEST(AreaPoints, OfAClosedAreaLightLieOnAllSides) {
  Mesh ball = prt::sphere_mesh(6);
  Eigen::Vector3f middle = Eigen::Vector3f::Zero();
  for (const AreaPoint& point : area_points(ball, 12)) {
    middle += point.position / 12.0f;
    EXPECT_GT(point.normal.dot(point.position.normalized()), 0.7f);
    EXPECT_GT(point.position.norm(), 0.7f * 0.5f);
  }
  EXPECT_LT(middle.norm(), 0.03f);
}

TEST(AreaPoints, OfDarkAreaLightsAreNone) {
  EXPECT_TRUE(area_points(area_light(0.0f, {0, 0, 0}), 16).empty());
  EXPECT_TRUE(area_points(Mesh(), 16).empty());
}

}  // namespace
}  // namespace refield::dynamic
