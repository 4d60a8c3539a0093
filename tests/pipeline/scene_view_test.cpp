// SPDX-License-Identifier: Apache-2.0
// The viewer on a scene that moves, in a real window on an X server without a screen: scripts drag objects
// and area lights, and what is seen then is what `render` makes of the scene with all in those
// places.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>

#include "core/field/mesh.h"
#include "core/image/image_io.h"
#include "tests/pipeline/view_program.h"

namespace refield {
namespace {

using nlohmann::json;
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

Eigen::Vector3f middle_of(const json& place, std::size_t thing) {
  const json& m = place["things"][thing]["middle"];
  return {m[0].get<float>(), m[1].get<float>(), m[2].get<float>()};
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
  int view(const Places& places, const std::string& script) {
    write_text_atomically(path("scene.toml"), scene_text(places));
    return play(script, "scene.toml");
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
  double difference(const std::string& saved, const Image& expected) const {
    return test::relative_difference(read_image(path(saved)), expected);
  }
};

/// EXR of half precision, and places that `where` printed in nine digits.
constexpr double rounding = 2e-3;

TEST_F(ViewScene, AMouseDragsAnObjectOverTheFloor) {
  const Places start{.ball_path = "path = [[0, -0.4, 0.5, 0.0], [2, 0.4, 0.9, 0.1]]"};
  // The ball's middle is seen near (297, 365) of the image.
  ASSERT_EQ(view(start, "wait 3\nwhere\nsave " + path("before.exr") +
                            "\ndrag image 297 365 497 365 12\nwhere\nsave " + path("after.exr") +
                            "\nscreenshot " + path("window.png") + "\nfps\nquit\n"),
            0)
      << output_;
  const auto where = places();
  ASSERT_EQ(where.size(), 2u) << output_;
  ASSERT_EQ(where[0]["image"]["width"], width);
  ASSERT_EQ(where[0]["image"]["height"], height);
  EXPECT_EQ(where[1]["selected"], 1);
  const Eigen::Vector3f before = middle_of(where[0], 1), after = middle_of(where[1], 1);
  EXPECT_NEAR(after.y(), before.y(), 1e-5f);
  EXPECT_GT(after.x(), before.x() + 0.5f);
  EXPECT_LT(difference("before.exr", simulated({.ball = before})), rounding);
  const Image moved = simulated({.ball = after});
  EXPECT_LT(difference("after.exr", moved), rounding);
  EXPECT_GT(difference("before.exr", moved), 0.1);
  EXPECT_EQ(where[1]["camera"], where[0]["camera"]);
  EXPECT_THAT(output_, HasSubstr(" frames, "));
}

TEST_F(ViewScene, MouseCommandsAndKeysMoveTheAreaLight) {
  const Places start{.area_light = {-0.5f, 1.5f, 0.6f}};
  PinholeCamera camera;
  camera.position = {0.2f, 1.6f, -3.4f};
  camera.target = {0.0f, 0.5f, 0.0f};
  camera.width = width;
  camera.height = height;
  const Eigen::Vector2f seen = *camera.image_point(start.area_light);
  const std::string from = std::to_string(seen.x()) + " " + std::to_string(seen.y());
  const std::string to = std::to_string(seen.x() + 150.0f) + " " + std::to_string(seen.y());
  ASSERT_EQ(
      view(start, "wait 3\nwhere\nsave " + path("before.exr") +
                      "\npress area light\nkey Right\nwhere\nsave " + path("placed.exr") +
                      "\nkey [\nkey [\nkey [\nsave " + path("dim.exr") + "\npress Reset object\nsave " +
                      path("back.exr") + "\nkey Right\nkey PageUp\nwhere\npress Reset object\ndrag image " +
                      from + " " + to + " 8\nwhere\nsave " + path("dragged.exr") + "\nquit\n"),
      0)
      << output_;
  const auto where = places();
  ASSERT_EQ(where.size(), 4u) << output_;
  EXPECT_LT(difference("before.exr", simulated(start)), rounding);
  const Eigen::Vector3f placed = middle_of(where[1], 2);
  EXPECT_GT(placed.x(), -0.5f);
  EXPECT_LT(difference("placed.exr", simulated({.area_light = placed})), rounding);
  EXPECT_LT(difference("dim.exr", simulated({.area_light = placed, .area_light_gain = 0.5})), rounding);
  EXPECT_LT(difference("back.exr", read_image(path("before.exr"))), 1e-6);
  EXPECT_GT(middle_of(where[2], 2).x(), -0.5f);
  EXPECT_GT(middle_of(where[2], 2).y(), 1.5f);
  const Eigen::Vector3f dragged = middle_of(where[3], 2);
  EXPECT_GT(dragged.x(), -0.2f);
  EXPECT_LT(difference("dragged.exr", simulated({.area_light = dragged})), rounding);
}

TEST_F(ViewScene, TheScenesOwnMotionPlaysAndAHandAddsToIt) {
  const Places start{.ball_path = "path = [[0, -0.4, 0.5, 0.0], [2, 0.4, 0.9, 0.1]]"};
  ASSERT_EQ(view(start, "wait 3\nkey Space\nwait 30\nkey Space\nwhere\nsave " + path("later.exr") +
                            "\npress shiny ball\nkey PageUp\nwhere\nkey Space\nwait 30\nkey Space\nwhere\n"
                            "press Start over\nwhere\nkey Shift+B\nkey Shift+B\nkey Shift+B\nsave " +
                            path("direct.exr") + "\nquit\n"),
            0)
      << output_;
  const auto where = places();
  ASSERT_EQ(where.size(), 4u) << output_;
  const auto time = [&](std::size_t place) { return where[place]["time"].get<double>(); };
  EXPECT_GT(time(0), 0.0);
  EXPECT_LT(difference("later.exr", simulated(start, std::to_string(time(0)))), rounding);
  const Eigen::Vector3f lifted = middle_of(where[1], 1) - middle_of(where[0], 1);
  EXPECT_GT(lifted.y(), 0.01f);
  const Eigen::Vector3f by_itself =
      Eigen::Vector3f(-0.4f, 0.5f, 0.0f) + Eigen::Vector3f(0.4f, 0.2f, 0.05f) * static_cast<float>(time(2));
  EXPECT_NE(time(2), time(1));
  EXPECT_LT((middle_of(where[2], 1) - by_itself - lifted).norm(), 1e-5f);
  EXPECT_LT((middle_of(where[3], 1) - Eigen::Vector3f(-0.4f, 0.5f, 0.0f)).norm(), 1e-5f);
  const Image all = simulated(start);
  EXPECT_GT(difference("direct.exr", all), 0.005);
  double direct = 0.0, sum = 0.0;
  for (const float value : read_image(path("direct.exr")).values) direct += value;
  for (const float value : all.values) sum += value;
  EXPECT_LT(direct, sum);
  EXPECT_EQ(time(3), 0.0);
}

TEST_F(ViewScene, DragsBesideThingsTurnTheCameraAndClicksSelect) {
  ASSERT_EQ(view({},
                 "wait 3\nwhere\ndrag image 100 650 160 650 5\nwhere\npick 297 365\nwhere\n"
                 "drag image 297 365 397 365 5\nwhere\nkey Escape\nkey F\nwhere\nquit\n"),
            0)
      << output_;
  const auto where = places();
  ASSERT_EQ(where.size(), 5u) << output_;
  EXPECT_NE(where[1]["camera"], where[0]["camera"]);
  EXPECT_EQ(where[1]["things"], where[0]["things"]);
  EXPECT_EQ(where[4]["camera"], where[0]["camera"]);
  EXPECT_EQ(where[4]["selected"], nullptr);
}

TEST_F(ViewScene, SaysWhatIsWrong) {
  EXPECT_EQ(view({}, "wait 2\npress moon\n"), 2);
  EXPECT_THAT(output_, HasSubstr("script, line 2: there is no control 'moon'"));
  EXPECT_EQ(view({}, "save-light light.exr\n"), 2);
  EXPECT_THAT(output_, HasSubstr("requires a field"));
  EXPECT_EQ(view({}, "drag light 1 1 2 2\n"), 2);
  EXPECT_THAT(output_, HasSubstr("no light map"));
  EXPECT_EQ(test::run_program({"view", path("scene.toml"), "--light", path("sky.exr")}, path("log")), 2);
  EXPECT_THAT(read_text(path("log")), HasSubstr("sky.exr"));
  EXPECT_EQ(test::run_program({"view", path("none.toml")}, path("log")), 2);
  EXPECT_THAT(read_text(path("log")), HasSubstr("none.toml"));
}

}  // namespace
}  // namespace refield
