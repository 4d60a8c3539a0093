// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/area_points.h"

#include <gtest/gtest.h>

#include "simulate/prt/mesh_shapes.h"

namespace refield::dynamic {
namespace {

Mesh lamp(float radiance, const Eigen::Vector3f& position) {
  Mesh mesh = prt::plane_mesh(2);
  for (auto& colour : mesh.colours) colour = {radiance, 0.5f * radiance, 0.0f};
  for (auto& point : mesh.positions) point += position;
  return mesh;
}

TEST(AreaPoints, TogetherHaveThePowerOfTheLamp) {
  for (const int count : {1, 3, 16, 100}) {
    Eigen::Array3f power = Eigen::Array3f::Zero();
    Eigen::Vector3f middle = Eigen::Vector3f::Zero();
    for (const AreaPoint& point : area_points(lamp(2.0f, {0, 0, 0}), count)) {
      power += point.power;
      middle += point.position / static_cast<float>(count);
    }
    EXPECT_NEAR(power[0], 2.0f, 1e-4f) << count;
    EXPECT_NEAR(power[1], 1.0f, 1e-4f) << count;
    EXPECT_EQ(power[2], 0.0f);
    EXPECT_LT(middle.norm(), count >= 16 ? 0.1f : 0.5f) << count;
  }
}

TEST(AreaPoints, GoWhereMostLightIs) {
  Mesh both = lamp(9.0f, {-2, 0, 0});
  const Mesh weak = lamp(1.0f, {2, 0, 0});
  const auto first = static_cast<std::uint32_t>(both.positions.size());
  both.positions.insert(both.positions.end(), weak.positions.begin(), weak.positions.end());
  both.colours.insert(both.colours.end(), weak.colours.begin(), weak.colours.end());
  for (const auto& [a, b, c] : weak.triangles) both.triangles.push_back({first + a, first + b, first + c});
  int strong = 0;
  for (const AreaPoint& point : area_points(both, 100)) strong += point.position.x() < 0.0f;
  EXPECT_EQ(strong, 90);
}

TEST(AreaPoints, OfDarkLampsAreNone) {
  EXPECT_TRUE(area_points(lamp(0.0f, {0, 0, 0}), 16).empty());
  EXPECT_TRUE(area_points(Mesh(), 16).empty());
}

}  // namespace
}  // namespace refield::dynamic
