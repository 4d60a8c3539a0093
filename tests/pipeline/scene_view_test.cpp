// SPDX-License-Identifier: Apache-2.0
// The viewer on a scene that moves, in a real window on an X server without a screen: what is seen after
// mouse and keys moved objects and area lights is what `render` makes of the scene with all in those places.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>

#include "core/field/mesh.h"
#include "core/image/image_io.h"
#include "tests/pipeline/view_program.h"

namespace refield {
namespace {

using testing::HasSubstr;

/// What ViewScene's window leaves to the picture.
constexpr int width = 796, height = 714;

struct Places {
  Eigen::Vector3f ball = {-0.4f, 0.5f, 0.0f}, area_light = {-0.5f, 2.2f, -0.6f};
  double area_light_gain = 1.0;
  std::string ball_path = {};  ///< TOML; empty: it stands
};

std::string text_of(const Eigen::Vector3f& v) {
  char text[100];
  std::snprintf(text, sizeof text, "[%.9g, %.9g, %.9g]", v.x(), v.y(), v.z());
  return text;
}

std::string scene_text(const Places& places) {
  const std::string place =
      places.ball_path.empty() ? "position = " + text_of(places.ball) : places.ball_path;
  return "[[material]]\nname = \"blue\"\ndiffuse = [0.4, 0.5, 0.7]\n"
         "[[material]]\nname = \"shiny\"\nkind = \"phong\"\ndiffuse = [0.4, 0.2, 0.1]\n"
         "specular = [0.4, 0.4, 0.4]\nexponent = 8\n"
         "[[object]]\nname = \"floor\"\nshape = \"plane\"\nresolution = 20\nsize = 3.0\n"
         "material = \"blue\"\n"
         "[[object]]\nname = \"shiny ball\"\nshape = \"sphere\"\nresolution = 8\nsize = 0.7\n"
         "material = \"shiny\"\n" +
         place + "\n[[light]]\nshape = \"plane\"\nsize = 0.8\nradiance = [" +
         std::to_string(12.0 * places.area_light_gain) + ", " +
         std::to_string(11.0 * places.area_light_gain) + ", " +
         std::to_string(10.0 * places.area_light_gain) + "]\nposition = " + text_of(places.area_light) +
         "\ntowards = [0, 0, 0]\n[camera]\nposition = [0.2, 1.6, -3.4]\ntarget = [0, 0.5, 0]\nwidth = " +
         std::to_string(width) + "\nheight = " + std::to_string(height) + "\n";
}

/// Where a key of the keyboard takes a thing: 2 % of its distance from the camera.
Eigen::Vector3f nudged(const Eigen::Vector3f& middle, const Eigen::Vector3f& direction) {
  const Eigen::Vector3f camera(0.2f, 1.6f, -3.4f);
  return middle + 0.02f * (middle - camera).norm() * direction;
}

/// `view` on a moving scene.
class ViewScene : public test::ViewProgram {
 protected:
  void SetUp() override {
    ViewProgram::SetUp();
    // The scenes of all tests consist of the same two objects.
    static const test::TemporaryFolder transport;
    ::setenv("REFIELD_CACHE", transport.path().c_str(), 1);
  }
  void view(const Places& places) {
    stem_ = "scene";
    write_text_atomically(path("scene.toml"), scene_text(places));
    open("scene.toml");
  }
  /// What `render` shows of a scene at a time.
  Image simulated(const Places& places, const std::string& time = "0") const {
    write_text_atomically(path("other.toml"), scene_text(places));
    EXPECT_EQ(
        test::run_program({"--quiet", "render", path("other.toml"), "--time", time, "-o", path("other.exr")},
                          path("other.log")),
        0)
        << read_text(path("other.log"));
    return read_image(path("other.exr"));
  }
  double difference_from(const Image& expected) { return test::relative_difference(picture(), expected); }
};

/// EXR of half precision, and places of the recipe in nine digits.
constexpr double rounding = 2e-3;
/// Where the middle of the ball is seen, and the floor beside it, in the window.
constexpr Point ball{305.0, 373.0}, floor_beside{108.0, 658.0};

TEST_F(ViewScene, AMouseDragsAnObjectOverTheFloor) {
  const Places start{.ball_path = "path = [[0, -0.4, 0.5, 0.0], [2, 0.4, 0.9, 0.1]]"};
  view(start);
  const Image before = picture();
  ASSERT_EQ(before.width, width);
  ASSERT_EQ(before.height, height);
  EXPECT_LT(test::relative_difference(before, simulated(start)), rounding);
  const Image after = drag(ball, {ball.x + 200.0, ball.y});
  // The ball follows the pointer: what was dark there is as bright as its middle was.
  const int x = static_cast<int>(ball.x) - 8, y = static_cast<int>(ball.y) - 8;
  EXPECT_GT(std::abs(after.at(x, y, 0) - before.at(x, y, 0)), 0.1f * before.at(x, y, 0));
  EXPECT_GT(test::relative_difference(after, before), 0.1);
  press("Delete");
  EXPECT_EQ(picture().values, before.values);
  quit();
}

TEST_F(ViewScene, KeysMoveAnObjectAndTheAreaLight) {
  const Places start{.area_light = {-0.5f, 1.5f, 0.6f}};
  view(start);
  press("Tab", 2);
  press("Right");
  press("Prior");  // PageUp
  Places moved = start;
  moved.ball = nudged(nudged(start.ball, Eigen::Vector3f::UnitX()), Eigen::Vector3f::UnitY());
  EXPECT_LT(difference_from(simulated(moved)), rounding);
  EXPECT_GT(difference_from(simulated(start)), 10.0 * rounding);
  press("Tab");
  press("Right");
  moved.area_light = nudged(start.area_light, Eigen::Vector3f::UnitX());
  EXPECT_LT(difference_from(simulated(moved)), rounding);
  press("bracketleft", 3);
  moved.area_light_gain = 0.5;
  EXPECT_LT(difference_from(simulated(moved)), rounding);
  press("r");
  EXPECT_LT(difference_from(simulated(start)), rounding);
  quit();
}

TEST_F(ViewScene, TheScenesOwnMotionPlays) {
  const Places start{.ball_path = "path = [[0, -0.4, 0.5, 0.0], [2, 0.4, 0.9, 0.1]]"};
  view(start);
  const Image first = picture();
  press("space");
  EXPECT_GT(difference_from(first), rounding);
  press("space");
  const Image stopped = picture();
  EXPECT_EQ(picture().values, stopped.values);
  press("r");
  EXPECT_EQ(picture().values, first.values);
  press("shift+b", 3);
  const Image direct = picture();
  EXPECT_GT(test::relative_difference(direct, first), 0.005);
  double sum = 0.0, sum_of_direct = 0.0;
  for (const float value : direct.values) sum_of_direct += value;
  for (const float value : first.values) sum += value;
  EXPECT_LT(sum_of_direct, sum);
  quit();
}

TEST_F(ViewScene, DragsBesideThingsTurnTheCamera) {
  view({});
  const Image before = picture();
  EXPECT_GT(test::relative_difference(drag(floor_beside, {floor_beside.x + 60.0, floor_beside.y}), before),
            0.1);
  press("f");
  EXPECT_EQ(picture().values, before.values);
  quit();
}

TEST_F(ViewScene, SaysWhatIsWrong) {
  write_text_atomically(path("scene.toml"), scene_text({}));
  EXPECT_EQ(refused("scene.toml", {"--light", path("sky.exr")}), 2);
  EXPECT_THAT(log_, HasSubstr("sky.exr"));
  EXPECT_EQ(refused("none.toml"), 2);
  EXPECT_THAT(log_, HasSubstr("none.toml"));
}

}  // namespace
}  // namespace refield
