// SPDX-License-Identifier: Apache-2.0
// The viewer in a real window on an X server without a screen: what mouse and keys do to the pictures that
// it saves and shows is what the field gives.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "core/base/files.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/image_io.h"
#include "relight/environment/environment.h"
#include "relight/field_pictures.h"
#include "relight/relight.h"
#include "relight/viewer/field/light_painter.h"
#include "simulate/geometry/mesh_shapes.h"
#include "tests/pipeline/view_program.h"
#include "tests/support/mesh_field.h"
#include "tests/support/random_data.h"

namespace refield {
namespace {

using testing::HasSubstr;

constexpr int width = 90, height = 70;
constexpr MonitorPlacement placement{
    .width_mm = 520.0, .height_mm = 390.0, .distance_mm = 500.0, .turn = {.yaw = 20.0}};
constexpr LightDomain monitor{64, 48, Parameterisation::monitor};
constexpr LightDomain sphere{64, 32, Parameterisation::lat_long};

// What ViewerWindow::draw() makes of a window of 1200×760: a light map of 64 texels at the upper right, whose
// texels are squares of 6 pixels, and a picture of 792×714 at the left.
constexpr double texel_px = 6.0, light_left = 808.0, panel_top = 8.0, picture_left = 8.0;
constexpr int picture_width = 792, picture_height = 714;

Point on_light(double x, double y) {
  return {light_left + texel_px * x, panel_top + texel_px * y};
}

/// Rounding of float and of saved files; and the 8-bit levels of a picture on the screen.
constexpr double rounding = 1e-5;
constexpr int rounding_levels = 1;

ReflectanceField small_field(const LightDomain& domain) {
  Rng rng{8};
  ReflectanceField field = test::random_field(rng, width, height, domain, 300, 12);
  field.quality.predicted_error.assign(static_cast<std::size_t>(width) * height, 0.1f);
  field.quality.photograph_noise = field.quality.predicted_error;
  if (domain.parameterisation == Parameterisation::monitor) field.monitors = {placement};
  return field;
}

class ViewField : public test::ViewProgram {
 protected:
  void view(const LightDomain& domain, const std::vector<std::string>& more = {}) {
    field_ = small_field(domain);
    write_reflectance_field(path("a.rfield"), field_);
    open("a.rfield", more);
  }
  void expect_shown(const LightMap& light) {
    EXPECT_LT(test::relative_difference(picture(), field_.relight(light)), rounding);
  }
  ReflectanceField field_;
};

/// On the monitor, the first one at that place.
LightMap light_of_the_start(double x, double y) {
  LightSetup setup(monitor);
  setup.ambient = 0.03;
  setup.light_sources.push_back({PaintedLight::Shape::spot, x, y, 0.2, {1.0f, 0.72f, 0.42f}, 1.0, true});
  setup.light_sources.push_back({PaintedLight::Shape::spot, 0.75, 0.6, 0.14, {0.3f, 0.55f, 1.0f}, 1.0, true});
  LightPainter painter(monitor);
  painter.paint(setup);
  return painter.light();
}

/// Largest difference of two screenshots in an area of the window.
float change_in(const Area& area, const Image& a, const Image& b) {
  float largest = 0.0f;
  for (int y = static_cast<int>(area.y); y < static_cast<int>(area.y + area.height); ++y)
    for (int x = static_cast<int>(area.x); x < static_cast<int>(area.x + area.width); ++x)
      for (int c = 0; c < 3; ++c) largest = std::max(largest, std::abs(a.at(x, y, c) - b.at(x, y, c)));
  return largest;
}

TEST_F(ViewField, ACameraGoesAroundAMesh) {
  const ReflectanceField field = test::unshadowed_field(prt::rabbit_mesh(10));
  write_reflectance_field(path("a.rfield"), field);
  open("a.rfield");
  const Image start = picture();
  EXPECT_EQ(start.width, picture_width);
  EXPECT_EQ(start.height, picture_height);
  EXPECT_GT(test::relative_difference(drag({300, 300}, {400, 250}), start), 0.1);
  press("f");
  EXPECT_EQ(picture().values, start.values);
  act({"click", "4"});  // the wheel
  EXPECT_GT(test::relative_difference(picture(), start), 0.1);
  quit();
}

TEST_F(ViewField, DraggedPaintedLightRelightsTheScene) {
  view(monitor);
  expect_shown(light_of_the_start(0.3, 0.35));
  drag(on_light(19, 17), on_light(39, 27));
  expect_shown(light_of_the_start(0.3 + 20.0 / 64, 0.35 + 10.0 / 48));
  press("r");
  expect_shown(light_of_the_start(0.3, 0.35));
  quit();
}

TEST_F(ViewField, TheWindowShowsTheRelitImage) {
  view(monitor);
  press("z");
  const Image seen = shot(), relit = field_.relight(light_of_the_start(0.3, 0.35));
  const auto levels = tone_mapped(relit, {exposure_to_white(relit)});
  const int left = static_cast<int>(picture_left) + (picture_width - width) / 2,
            top = static_cast<int>(panel_top) + (picture_height - height) / 2;
  long worst = 0;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int c = 0; c < 3; ++c) {
        const long level = levels[(static_cast<std::size_t>(y) * width + x) * 3 + c];
        const long shown = std::lround(255.0f * srgb_from_linear(seen.at(left + x, top + y, c)));
        worst = std::max(worst, std::abs(shown - level));
      }
  EXPECT_LE(worst, rounding_levels);
  // A constant map of errors is one colour, unlike the scene.
  press("3");
  const Image error = shot();
  for (int c = 0; c < 3; ++c) EXPECT_EQ(error.at(left + 10, top + 10, c), error.at(left + 70, top + 60, c));
  press("1");
  // A click puts the pixel's kernels over the light map, and moves no buttons.
  const Area light{light_left, panel_top, 64 * texel_px, 48 * texel_px},
      buttons{light_left, panel_top + light.height + 8, 270, 40};
  const Image before = shot();
  click({left + 37.5, top + 21.5});
  const Image picked = shot();
  EXPECT_GT(change_in(light, before, picked), 0.01f);
  EXPECT_EQ(change_in(buttons, before, picked), 0.0f);
  press("Escape");
  EXPECT_EQ(change_in(light, before, shot()), 0.0f);
  quit();
}

TEST_F(ViewField, LoadedMapTurnsAndMoves) {
  Rng rng{3};
  const LightMap map = test::random_light(rng, sphere);
  write_exr(path("map.exr"), map.radiance);
  view(sphere, {"--light", path("map.exr")});
  expect_shown(map);
  drag(on_light(24, 10), on_light(40, 10));
  expect_shown(rotated(map, 0.25));
  drag(on_light(40, 10), on_light(24, 10));
  expect_shown(map);
  press("space");
  EXPECT_GT(test::relative_difference(picture(), field_.relight(map)), rounding);
  press("space");
  const Image stopped = picture();
  EXPECT_EQ(picture().values, stopped.values);
  quit();
}

TEST_F(ViewField, SurroundingsTurnBehindTheMonitorsWindow) {
  Rng rng{4};
  const LightMap map = test::random_light(rng, {128, 64, Parameterisation::lat_long});
  write_exr(path("map.exr"), map.radiance);
  view(monitor, {"--light", path("map.exr")});
  const EnvironmentProjector projector(monitor, std::span(&placement, 1));
  expect_shown(projector.project(map, {}).light);
  EXPECT_THAT(output_->text(), HasSubstr("of its light comes from the directions of the monitor"));
  press("period", 8);  // by 5° each
  expect_shown(projector.project(map, {.yaw = 40.0}).light);
  quit();
}

TEST_F(ViewField, TheRightButtonProbesTheLight) {
  view(monitor);
  move_to(on_light(20.5, 30.5));
  act({"mousedown", "3"});
  LightMap alone{Image(monitor.width, monitor.height, 3), monitor.parameterisation};
  for (int c = 0; c < 3; ++c) alone.radiance.at(20, 30, c) = 1.0f;
  expect_shown(alone);
  act({"mouseup", "3"});
  expect_shown(light_of_the_start(0.3, 0.35));
  quit();
}

TEST_F(ViewField, SaysWhatIsWrong) {
  EXPECT_EQ(refused("none.rfield"), 2);
  EXPECT_THAT(log_, HasSubstr("none.rfield"));
  write_reflectance_field(path("a.rfield"), small_field(sphere));
  EXPECT_EQ(refused("a.rfield", {"--light", path("missing.exr")}), 2);
  EXPECT_THAT(log_, HasSubstr("missing.exr"));
  write_exr(path("square.exr"), Image(16, 16, 3, 1.0f));
  EXPECT_EQ(refused("a.rfield", {"--light", path("square.exr")}), 2);
  EXPECT_THAT(log_, HasSubstr("16×16, the field expects a lat-long map"));
  screen_.reset();
  EXPECT_EQ(refused("a.rfield"), 2);
  EXPECT_THAT(log_, HasSubstr("no display"));
}

}  // namespace
}  // namespace refield
