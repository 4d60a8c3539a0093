// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/area_lights.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <fstream>

#include "core/base/errors.h"
#include "tests/support/message_of.h"
#include "tests/support/temporary_folder.h"

namespace refield::prt {
namespace {

AreaLights read(const std::string& text) {
  const refield::test::TemporaryFolder folder;
  const auto path = folder.path() / "lights.toml";
  std::ofstream(path) << text;
  return read_area_lights(path);
}

TEST(AreaLights, MoveAlongTheirPaths) {
  const AreaLights lights = read(R"(
[[light]]
shape = "sphere"
size = 0.5
resolution = 4
radiance = [4, 2, 1]
path = [[0, 0, 3, 0], [2, 4, 3, 0], [3, 4, 3, 8]]

[[light]]
shape = "box"
position = [0, 5, 0]
radiance = [1, 1, 1]
)");
  ASSERT_EQ(lights.lights.size(), 2u);
  EXPECT_EQ(lights.duration(), 3.0);
  const AreaLight& ball = lights.lights[0];
  EXPECT_LT((ball.motion.position(-1.0) - Eigen::Vector3f(0, 3, 0)).norm(), 1e-6f);
  EXPECT_LT((ball.motion.position(0.5) - Eigen::Vector3f(1, 3, 0)).norm(), 1e-6f);
  EXPECT_LT((ball.motion.position(2.25) - Eigen::Vector3f(4, 3, 2)).norm(), 1e-6f);
  EXPECT_LT((ball.motion.position(9.0) - Eigen::Vector3f(4, 3, 8)).norm(), 1e-6f);
  const Mesh mesh = lights.at(0.5);
  const std::size_t corners = ball.shape.positions.size();
  ASSERT_EQ(mesh.positions.size(), corners + lights.lights[1].shape.positions.size());
  for (std::size_t v = 0; v < corners; ++v)
    EXPECT_NEAR((mesh.positions[v] - Eigen::Vector3f(1, 3, 0)).norm(), 0.25f, 1e-5f);
  EXPECT_TRUE((mesh.colours[0] == Eigen::Array3f(4, 2, 1)).all());
  for (const auto& triangle : mesh.triangles)
    for (const std::uint32_t corner : triangle) EXPECT_LT(corner, mesh.positions.size());
}

TEST(AreaLights, TurnTowardsWhatTheyLight) {
  const Mesh mesh = read(R"(
[[light]]
shape = "plane"
radiance = [1, 1, 1]
path = [[0, 3, 0, 0], [1, 0, 2, 0]]
towards = [0, 0, 0]
)")
                        .at(0.5);
  const Eigen::Vector3f place(1.5f, 1.0f, 0.0f);
  for (std::size_t v = 0; v < mesh.positions.size(); ++v) {
    EXPECT_LT((mesh.normals[v] + place.normalized()).norm(), 1e-5f);
    EXPECT_NEAR((mesh.positions[v] - place).dot(place), 0.0f, 1e-5f);
  }
}

TEST(AreaLights, RefuseWhatCannotBe) {
  const auto refuse = [](const std::string& keys) {
    return refield::test::message_of<InputError>([&] { read("[[light]]\nshape = \"sphere\"\n" + keys); });
  };
  EXPECT_THAT(refuse("radiance = [1, 1, 1]"), testing::HasSubstr("either `position` or"));
  EXPECT_THAT(refuse("position = [0, 0, 0]"), testing::HasSubstr("radiance"));
  EXPECT_THAT(refuse("position = [0, 0, 0]\nradiance = [-1, 1, 1]"), testing::HasSubstr("radiance"));
  EXPECT_THAT(refuse("radiance = [1, 1, 1]\npath = [[1, 0, 0, 0], [1, 1, 0, 0]]"),
              testing::HasSubstr("ascending times"));
  EXPECT_THAT(refuse("radiance = [1, 1, 1]\npath = [[1, 0, 0]]"), testing::HasSubstr("[seconds, x, y, z]"));
  EXPECT_THAT(refuse("radiance = [1, 1, 1]\npath = []"), testing::HasSubstr("give keyframes"));
  EXPECT_THAT(refuse("radiance = [1, 1, 1]\nposition = [0, 0, 0]\ncolour = 3"), testing::HasSubstr("colour"));
}

}  // namespace
}  // namespace refield::prt
