// SPDX-License-Identifier: Apache-2.0

#include <gtest/gtest.h>

#include <Eigen/LU>

#include "core/base/errors.h"
#include "core/light/light_map.h"
#include "core/light/monitor_placement.h"

namespace refield {
namespace {

using Eigen::Vector3d;
constexpr double rounding = 1e-12;

void expect_near(const Vector3d& found, const Vector3d& expected) {
  EXPECT_NEAR((found - expected).norm(), 0.0, rounding) << found.transpose();
}

TEST(Turn, YawGoesRightPitchDownRollLiftsTheRight) {
  expect_near(rotation_of(EulerAngles{.yaw = 90}) * Vector3d::UnitZ(), Vector3d::UnitX());
  expect_near(rotation_of(EulerAngles{.pitch = 90}) * Vector3d::UnitZ(), -Vector3d::UnitY());
  expect_near(rotation_of(EulerAngles{.roll = 90}) * Vector3d::UnitX(), Vector3d::UnitY());
  // Roll first, yaw last: the head stays rolled about where one looks in the end.
  const Eigen::Matrix3d all = rotation_of(EulerAngles{90, 0, 90});
  expect_near(all * Vector3d::UnitZ(), Vector3d::UnitX());
  expect_near(all * Vector3d::UnitX(), Vector3d::UnitY());
}

TEST(Turn, FullCirclesAreNone) {
  EXPECT_TRUE((EulerAngles{360, -720, 0}.is_none()));
  EXPECT_FALSE((EulerAngles{0, 0, 1e-9}.is_none()));
}

TEST(CubeFaces, StandUprightForSomeoneInside) {
  const Vector3d ahead[] = {Vector3d::UnitX(),  -Vector3d::UnitX(), Vector3d::UnitY(),
                            -Vector3d::UnitY(), Vector3d::UnitZ(),  -Vector3d::UnitZ()};
  for (int face = 0; face < 6; ++face) {
    const Eigen::Matrix3d axes = cube_face_axes(face);
    expect_near(axes.row(2).transpose(), ahead[face]);
    EXPECT_NEAR((axes * axes.transpose() - Eigen::Matrix3d::Identity()).norm(), 0.0, rounding);
    EXPECT_GT(axes.determinant(), 0.0);  // right, up, ahead as +X, +Y, +Z: nothing is mirrored
    if (face / 2 != 1) expect_near(axes.row(1).transpose(), Vector3d::UnitY());
  }
  expect_near(cube_face_axes(0).row(0).transpose(), -Vector3d::UnitZ());
  EXPECT_THROW(cube_face_axes(6), InputError);
}

TEST(MonitorPlacement, SeesItsCornersWhereTheyAre) {
  MonitorPlacement monitor{400, 300, 500};
  expect_near(screen_direction(monitor, 0.5, 0.5), {0, 0, 1});
  expect_near(screen_direction(monitor, 0, 0), {-0.4, 0.3, 1});  // top left
  monitor.turn.yaw = 90;                                         // to the camera's right
  expect_near(screen_direction(monitor, 0.5, 0.5), {1, 0, 0});
  expect_near(screen_direction(monitor, 1, 1), {1, -0.3, -0.4});  // its right edge is nearer to the camera
  monitor.offset_y_mm = 250;
  expect_near(screen_direction(monitor, 0.5, 0.5), {1, 0.5, 0});
}

TEST(MonitorPlacement, IsReadFromTextAndWritten) {
  const MonitorPlacement monitor = monitor_placement_from_text("520x320.5@600,yaw=90,pitch=-5,x=10,y=-20");
  EXPECT_EQ(monitor, (MonitorPlacement{520, 320.5, 600, {90, -5, 0}, 10, -20}));
  EXPECT_EQ(text_of(monitor), "520x320.5@600,yaw=90,pitch=-5,x=10,y=-20");
  for (const char* wrong : {"", "520x320", "520x320@", "520x320@600,", "520x320@600,yaw", "520x320@600,up=3",
                            "520x320@600 yaw=3", "520x320@0", "-1x320@600", "520x320@nan", "axb@c"})
    EXPECT_THROW(monitor_placement_from_text(wrong), InputError) << wrong;
}

TEST(MonitorPlacement, FitsTheLightMapOrIsRefused) {
  const std::vector<MonitorPlacement> two(2, MonitorPlacement{400, 300, 500});
  EXPECT_NO_THROW(check_placements(two, {8, 12, Parameterisation::monitor}, "it"));
  EXPECT_NO_THROW(check_placements({}, {8, 13, Parameterisation::lat_long}, "it"));
  EXPECT_THROW(check_placements(two, {8, 13, Parameterisation::monitor}, "it"), InputError);
  EXPECT_THROW(check_placements(two, {8, 4, Parameterisation::lat_long}, "it"), InputError);
}

}  // namespace
}  // namespace refield
