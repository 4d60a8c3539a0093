// SPDX-License-Identifier: Apache-2.0
// The viewer in a real window on an X server without a screen, driven by scripts whose mouse and keys go the
// way of a user's: what the screenshots hold is what the field gives.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "core/base/files.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/image_io.h"
#include "relight/environment/environment.h"
#include "relight/field_pictures.h"
#include "relight/sequence.h"
#include "relight/viewer/field/light_painter.h"
#include "simulate/geometry/mesh_shapes.h"
#include "tests/pipeline/view_program.h"
#include "tests/support/mesh_field.h"
#include "tests/support/random_data.h"

namespace refield {
namespace {

using nlohmann::json;
using testing::HasSubstr;

constexpr int width = 90, height = 70;
constexpr MonitorPlacement placement{
    .width_mm = 520.0, .height_mm = 390.0, .distance_mm = 500.0, .turn = {.yaw = 20.0}};

ReflectanceField small_field(const LightDomain& domain) {
  Rng rng{8};
  ReflectanceField field = test::random_field(rng, width, height, domain, 300, 12);
  field.quality.predicted_error.assign(static_cast<std::size_t>(width) * height, 0.1f);
  field.quality.photograph_noise = field.quality.predicted_error;
  if (domain.parameterisation == Parameterisation::monitor) field.monitors = {placement};
  return field;
}

/// Of fields.
class ViewField : public test::ViewProgram {
 protected:
  int view(const LightDomain& domain, const std::string& script) {
    write_reflectance_field(path("a.rfield"), small_field(domain));
    return play(script);
  }
  /// On the field that is there.
  int play(const std::string& script) { return ViewProgram::play(script, "a.rfield"); }

  /// The relit image inside a screenshot taken at 1:1 is the tone-mapped `light` on the field, to a level.
  void expect_shown(const std::string& screenshot, const json& place, const LightMap& light) const {
    const Image shot = read_image(path(screenshot));
    const Image expected = small_field(light.domain()).relight(light);
    const auto levels = tone_mapped(expected, {place["exposure"].get<double>()});
    ASSERT_EQ(place["image"]["scale"].get<double>(), 1.0);
    const int left = place["image"]["x"].get<int>(), top = place["image"]["y"].get<int>();
    int worst = 0;
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        for (int c = 0; c < 3; ++c) {
          const auto shown = std::lround(255.0f * srgb_from_linear(shot.at(left + x, top + y, c)));
          const int wanted = levels[(static_cast<std::size_t>(y) * width + x) * 3 + c];
          worst = std::max(worst, std::abs(static_cast<int>(shown) - wanted));
        }
    EXPECT_LE(worst, 1) << screenshot;
  }
};

constexpr LightDomain monitor{64, 48, Parameterisation::monitor};
constexpr LightDomain sphere{64, 32, Parameterisation::lat_long};

/// Presses the key that turns the map by 5°.
std::string turned_by(int degrees) {
  std::string script;
  for (int turned = 0; turned < degrees; turned += 5) script += "\nkey .";
  return script;
}

/// On the monitor, the first one at that place.
LightSetup light_sources_of_the_start(double x, double y) {
  LightSetup setup(monitor);
  setup.set_ambient(0.03);
  setup.add({PaintedLight::Shape::spot, x, y, 0.2, {1.0f, 0.72f, 0.42f}, 1.0, true});
  setup.add({PaintedLight::Shape::spot, 0.75, 0.6, 0.14, {0.3f, 0.55f, 1.0f}, 1.0, true});
  return setup;
}

TEST_F(ViewField, ACameraGoesAroundAMesh) {
  const ReflectanceField field = test::unshadowed_field(prt::rabbit_mesh(10));
  write_reflectance_field(path("a.rfield"), field);
  // By hand, and by commands; then a click, which turns nothing.
  ASSERT_EQ(play("wait 3\nwhere\ndrag image 300 300 400 250 10\nwhere\nsave " + path("dragged.exr") +
                 "\npan 30 -20\nscroll image 300 300 3\nwhere\nsave " + path("moved.exr") + "\nsave-light " +
                 path("light.exr") + "\npick 400 350\nwhere\nkey F\nwhere\nquit\n"),
            0)
      << output_;
  const auto where = places();
  ASSERT_EQ(where.size(), 5u) << output_;
  const auto camera_of = [](const json& place) {
    const auto vector = [](const json& n) {
      return Eigen::Vector3f(n[0].get<float>(), n[1].get<float>(), n[2].get<float>());
    };
    const json& c = place["camera"];
    return PinholeCamera{vector(c["position"]),
                         vector(c["target"]),
                         Eigen::Vector3f::UnitY(),
                         c["fov"].get<float>(),
                         place["image"]["width"].get<int>(),
                         place["image"]["height"].get<int>()};
  };
  EXPECT_LT(camera_of(where[1]).position.x(), -0.1f);  // what is dragged to the right follows
  EXPECT_LT(camera_of(where[1]).position.y(), camera_of(where[0]).position.y());
  const LightMap light = read_light_map(path("light.exr"), Parameterisation::cube);
  for (const auto& [place, file] : {std::pair{where[1], "dragged.exr"}, {where[2], "moved.exr"}}) {
    const Image expected = FieldPictures(field, {camera_of(place)}).picture(light, 0);
    // `where` rounds the camera to seven digits.
    EXPECT_LT(test::relative_difference(read_image(path(file)), expected), 0.01) << file;
  }
  EXPECT_EQ(where[3]["camera"], where[2]["camera"]);
  EXPECT_EQ(where[3]["picked"], json::array({400, 350}));
  EXPECT_GT(where[3]["kernels"].get<int>(), 10);
  EXPECT_EQ(where[4]["camera"], where[0]["camera"]);
}

TEST_F(ViewField, DraggedPaintedLightRelightsTheScene) {
  // The first light source stands at (0.3, 0.35), texel (19.2, 16.8); the texel named is taken by its middle.
  ASSERT_EQ(view(monitor, "wait 3\nkey Z\nwhere\nsave-light " + path("before.exr") + "\nscreenshot " +
                              path("before.png") + "\ndrag light 19 17 39 27 20\nwhere\nsave-light " +
                              path("after.exr") + "\nscreenshot " + path("after.png") + "\nfps\nquit\n"),
            0)
      << output_;
  const auto place = places();
  ASSERT_EQ(place.size(), 2U) << output_;
  const LightMap before = read_light_map(path("before.exr"), monitor.parameterisation);
  const LightMap after = read_light_map(path("after.exr"), monitor.parameterisation);
  expect_shown("before.png", place[0], before);
  expect_shown("after.png", place[1], after);
  LightPainter expected(monitor);
  expected.paint(light_sources_of_the_start(0.3 + 20.0 / 64, 0.35 + 10.0 / 48));
  constexpr double mouse_rounding = 0.01;  // the pointer stands on whole pixels of the window or nearly so
  EXPECT_LT(test::relative_difference(after.radiance, expected.light().radiance), mouse_rounding);
  EXPECT_GT(test::relative_difference(before.radiance, expected.light().radiance), 0.3);
  EXPECT_THAT(output_, HasSubstr(" frames, "));
}

TEST_F(ViewField, LoadedMapTurns) {
  Rng rng{3};
  const LightMap map = test::random_light(rng, sphere);
  write_exr(path("map.exr"), map.radiance);
  ASSERT_EQ(
      view(sphere, "wait 3\nkey Z\nload " + path("map.exr") + "\nwhere\nscreenshot " + path("straight.png") +
                       "\ndrag light 24 10 40 10 8\nwhere\nscreenshot " + path("turned.png") +
                       "\ndrag light 40 10 24 10 8\nwhere\nscreenshot " + path("dragged.png") + "\nquit\n"),
      0)
      << output_;
  const auto place = places();
  ASSERT_EQ(place.size(), 3U) << output_;
  expect_shown("straight.png", place[0], map);
  EXPECT_NEAR(place[1]["turn"].get<double>(), 90.0, 1e-4);
  expect_shown("turned.png", place[1], rotated(map, 0.25));
  EXPECT_NEAR(place[2]["turn"].get<double>(), 0.0, 1e-4);  // 16 of 64 columns back
  expect_shown("dragged.png", place[2], map);
}

TEST_F(ViewField, SurroundingsTurnBehindTheMonitorsWindow) {
  Rng rng{4};
  const LightMap map = test::random_light(rng, {128, 64, Parameterisation::lat_long});
  write_exr(path("map.exr"), map.radiance);
  ASSERT_EQ(
      view(monitor, "wait 3\nkey Z\nload " + path("map.exr") + "\nwhere\nscreenshot " + path("straight.png") +
                        turned_by(40) + "\nwhere\nscreenshot " + path("turned.png") + "\nquit\n"),
      0)
      << output_;
  const auto place = places();
  ASSERT_EQ(place.size(), 2U) << output_;
  EXPECT_THAT(output_, HasSubstr("of its light comes from the directions of the monitor"));
  const EnvironmentProjector projector(monitor, std::span(&placement, 1));
  expect_shown("straight.png", place[0], projector.project(map, {}).light);
  expect_shown("turned.png", place[1], projector.project(map, {.yaw = 40.0}).light);
}

TEST_F(ViewField, LightInMotionMoves) {
  Rng rng{5};
  write_exr(path("map.exr"), test::random_light(rng, sphere).radiance);
  ASSERT_EQ(view(sphere, "load " + path("map.exr") + "\nwait 3\nwhere\nkey Space\nwait 100\nwhere\nquit\n"),
            0)
      << output_;
  const auto place = places();
  ASSERT_EQ(place.size(), 2U) << output_;
  EXPECT_EQ(place[0]["turn"].get<double>(), 0.0);
  EXPECT_GT(place[1]["turn"].get<double>(), 1.0);  // 30° a second; no machine draws 3000 frames in one
}

TEST_F(ViewField, PicksPixelsAndProbesTheLight) {
  ASSERT_EQ(
      view(monitor, "wait 3\nkey Z\nscreenshot " + path("plain.png") + "\npick 37 21\nwhere\nscreenshot " +
                        path("picked.png") + "\nkey Escape\nprobe 20 30\nwhere\nscreenshot " +
                        path("probe.png") + "\nrelease\nwhere\nscreenshot " + path("released.png") +
                        "\npress Error\nscreenshot " + path("error.png") + "\nquit\n"),
      0)
      << output_;
  const auto place = places();
  ASSERT_EQ(place.size(), 3U) << output_;
  const ReflectanceField field = small_field(monitor);
  const std::size_t pixel = 21 * width + 37;
  EXPECT_EQ(place[0]["picked"], json::parse("[37, 21]"));
  EXPECT_EQ(place[0]["kernels"], field.transfer.row_start[pixel + 1] - field.transfer.row_start[pixel]);
  // The light map's picture gives way to the kernels'.
  const Image plain = read_image(path("plain.png")), picked = read_image(path("picked.png"));
  const int x = place[0]["light"]["x"].get<int>() + 100, y = place[0]["light"]["y"].get<int>() + 100;
  double change = 0.0;
  for (int c = 0; c < 3; ++c) change += std::abs(plain.at(x, y, c) - picked.at(x, y, c));
  EXPECT_GT(change, 0.01);
  LightMap alone{Image(monitor.width, monitor.height, 3), monitor.parameterisation};
  for (int c = 0; c < 3; ++c) alone.radiance.at(20, 30, c) = 1.0f;
  expect_shown("probe.png", place[1], alone);
  LightPainter start(monitor);
  start.paint(light_sources_of_the_start(0.3, 0.35));
  expect_shown("released.png", place[2], start.light());
  // A constant map of errors is one colour, unlike the scene.
  const Image error = read_image(path("error.png"));
  const int left = place[2]["image"]["x"].get<int>(), top = place[2]["image"]["y"].get<int>();
  for (int c = 0; c < 3; ++c) EXPECT_EQ(error.at(left + 10, top + 10, c), error.at(left + 70, top + 60, c));
}

// A drag over an environment: frames go on while it is projected, and what is saved then is the last one.
TEST_F(ViewField, TurningAnEnvironmentDoesNotBlockTheWindow) {
  constexpr LightDomain fine{600, 450, Parameterisation::monitor};
  Rng rng{3};
  write_exr(path("sky.exr"), test::random_light(rng, {64, 32, Parameterisation::lat_long}).radiance);
  ASSERT_EQ(view(fine, "wait 3\nload " + path("sky.exr") + "\nwait 3\nfps" + turned_by(60) +
                           "\nwhere\nfps\nsave-light " + path("last.exr") + "\nquit\n"),
            0)
      << output_;
  const EnvironmentProjector projector(fine, std::span(&placement, 1));
  const LightMap expected =
      projector.project(read_light_map(path("sky.exr"), Parameterisation::lat_long), {.yaw = 60.0}).light;
  EXPECT_LT(test::relative_difference(read_image(path("last.exr")), expected.radiance), 2e-3);
  EXPECT_NEAR(places().at(0)["turn"].get<double>(), 60.0, 1e-3);
  // Of the second `fps`: "… longest 31.0 ms): light map 12.1 ms and relighting 26.0 ms in 15 of them, …". How
  // long frames take says nothing on a machine that tests in parallel; ViewStateUnderAnEnvironment looks at
  // that.
  const auto at = output_.rfind("longest ");
  ASSERT_NE(at, std::string::npos) << output_;
  EXPECT_THAT(output_.substr(at), HasSubstr("light map "));
}

// What is selected and what helps has places of its own.
TEST_F(ViewField, SelectingAPixelAndHelpLeaveThePanelsInView) {
  ASSERT_EQ(view(monitor, "wait 3\nwhere\npick 37 21\nwhere\nkey F1\nwait 3\nwhere\nscreenshot " +
                              path("help.png") + "\nquit\n"),
            0)
      << output_;
  const auto where = places();
  ASSERT_EQ(where.size(), 3U) << output_;
  for (const char* name : {"Open", "Save", "Scene", "Auto-expose", "Fit", "Help"})
    for (std::size_t i : {1U, 2U}) EXPECT_EQ(where[i]["controls"][name], where[0]["controls"][name]) << name;
  EXPECT_TRUE(where[1]["controls"].contains("Deselect"));
  EXPECT_FALSE(where[0]["controls"].contains("Deselect"));
  // The help is below the picture, which makes room, and nothing of it lies over the panels at the right.
  EXPECT_LT(where[2]["image"]["scale"], where[1]["image"]["scale"]);
  EXPECT_EQ(where[2]["light"], where[1]["light"]);
}

TEST_F(ViewField, OpensAndSavesByItsDialogs) {
  Rng rng{3};
  write_exr(path("map.exr"), test::random_light(rng, sphere).radiance);
  ASSERT_EQ(view(sphere, "wait 3\npress Open\nwait 2\npress map.exr\nwhere\npress Save\nwait 2\ntype " +
                             path("saved.exr") + "\npress Save file\nsave " + path("expected.exr") +
                             "\npress Save\nwait 2\npress Cancel\nwait 2\nwhere\nquit\n"),
            0)
      << output_;
  EXPECT_EQ(places().at(0)["light_sources"], 0);  // the map took their place
  EXPECT_EQ(read_image(path("saved.exr")).values, read_image(path("expected.exr")).values);
  EXPECT_FALSE(places().at(1)["controls"].contains("Cancel"));
}

TEST_F(ViewField, SaysWhatIsWrong) {
  // In the window: it stays open.
  ASSERT_EQ(view(sphere, "wait 2\nload " + path("missing.exr") + "\nwhere\nquit\n"), 0);
  EXPECT_EQ(places().at(0)["notice"], "error");
  EXPECT_THAT(output_, HasSubstr("missing.exr"));
  write_exr(path("square.exr"), Image(16, 16, 3, 1.0f));
  ASSERT_EQ(view(sphere, "wait 2\nload " + path("square.exr") + "\nwhere\nquit\n"), 0);
  EXPECT_THAT(output_, HasSubstr("16×16, the field expects a lat-long map"));
  // On the command line.
  EXPECT_EQ(view(sphere, "wait 2\npick one 2\n"), 2);
  EXPECT_THAT(output_, HasSubstr("script, line 2"));
  EXPECT_EQ(view(sphere, "wait 2\npress Nothing\n"), 2);
  EXPECT_THAT(output_, HasSubstr("no control 'Nothing'"));
  EXPECT_EQ(test::run_program({"view", path("none.rfield")}, path("log")), 2);
  EXPECT_THAT(read_text(path("log")), HasSubstr("none.rfield"));
  screen_.reset();
  EXPECT_EQ(view(sphere, "quit\n"), 2);
  EXPECT_THAT(output_, HasSubstr("no display"));
}

}  // namespace
}  // namespace refield
