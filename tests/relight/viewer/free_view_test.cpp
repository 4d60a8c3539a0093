// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/gui/free_view.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include "core/image/metrics.h"
#include "core/light/cube_map.h"
#include "relight/field_pictures.h"
#include "relight/viewer/field/light_painter.h"
#include "relight/viewer/field/view_state.h"
#include "simulate/geometry/mesh_shapes.h"
#include "tests/support/mesh_field.h"
#include "tests/support/random_data.h"

namespace refield {
namespace {

const PinholeCamera start = {{0, 0, -4}, {0, 0, 0}, {0, 1, 0}, 35.0f, 120, 90};

TEST(OrbitCamera, GoesAroundTheTarget) {
  OrbitCamera orbit(start);
  orbit.orbit(90.0, 0.0);  // to the camera's right
  EXPECT_LT((orbit.camera().position - Eigen::Vector3f(4, 0, 0)).norm(), 1e-5f);
  orbit.orbit(-90.0, 30.0);
  EXPECT_LT((orbit.camera().position - Eigen::Vector3f(0, 2, -4 * std::sqrt(0.75f))).norm(), 1e-5f);
  orbit.orbit(0.0, 500.0);  // not over the top
  EXPECT_NO_THROW(orbit.camera().check());
  EXPECT_NEAR(orbit.camera().position.norm(), 4.0f, 1e-5f);
  orbit.reset();
  EXPECT_EQ(orbit.camera().position, start.position);
}

TEST(OrbitCamera, ApproachesWithinLimits) {
  OrbitCamera orbit(start);
  orbit.approach(2.0);
  EXPECT_NEAR(orbit.camera().position.z(), -2.0f, 1e-5f);
  orbit.approach(1e30);
  EXPECT_NO_THROW(orbit.camera().check());
}

TEST(OrbitCamera, PansByPixels) {
  OrbitCamera orbit(start);
  orbit.orbit(40.0, 25.0);
  const auto before = orbit.camera().image_point(Eigen::Vector3f::Zero());
  orbit.pan(10.0, -7.0);
  const auto after = orbit.camera().image_point(Eigen::Vector3f::Zero());
  ASSERT_TRUE(before && after);
  EXPECT_LT((*after - *before - Eigen::Vector2f(10, -7)).norm(), 1e-3f);
}

TEST(PinholeCamera, ImagePointIsTheInverseOfDirection) {
  const PinholeCamera camera = {{1, 2, -3}, {0.2f, 0, 1}, {0.3f, 1, 0}, 50.0f, 64, 48};
  for (const auto& [x, y] : {std::pair{3.0f, 40.0f}, {32.0f, 24.0f}, {63.5f, 0.5f}}) {
    const auto point = camera.image_point(camera.position + 2.5f * camera.direction(x, y));
    ASSERT_TRUE(point);
    EXPECT_LT((*point - Eigen::Vector2f(x, y)).norm(), 1e-3f);
  }
  EXPECT_FALSE(camera.image_point(camera.position - camera.direction(10, 10)));
}

TEST(FreeView, IsRoughInMotionAndFineAtRest) {
  const ReflectanceField field = test::unshadowed_field(prt::sphere_mesh(6));
  FreeView view(field);
  const auto now = FreeView::Clock::now();
  view.move().orbit(20.0, 10.0);
  EXPECT_TRUE(view.update(now));
  EXPECT_TRUE(view.wants_rest());
  EXPECT_FALSE(view.update(now + FreeView::rest / 2));
  EXPECT_TRUE(view.update(now + FreeView::rest));
  EXPECT_FALSE(view.wants_rest());
  EXPECT_FALSE(view.update(now + 2 * FreeView::rest));
  const Image outputs(field.width, field.height, 3, 1.0f);
  EXPECT_EQ(view.seen().show(outputs).values, MeshRenderer(field, view.camera()).show(outputs).values);
}

TEST(LightPanorama, ShowsACubeAsSeenFromInside) {
  const LightPanorama panorama(cube_domain(16));
  ASSERT_TRUE(panorama.is_cube());
  EXPECT_EQ(panorama.shown().width, 2 * panorama.shown().height);
  // The middle looks along +Z, face 4; a quarter of the width to the right along +X, face 0.
  const Point ahead = panorama.texel_at({32.0, 16.0}), right = panorama.texel_at({48.0, 16.0});
  EXPECT_NEAR(ahead.y, 4 * 16 + 8, 1e-6);
  EXPECT_NEAR(right.y, 8, 1e-6);
  Image map(16, 96, 1);
  for (int x = 0; x < 16; ++x)
    for (int y = 64; y < 80; ++y) map.at(x, y, 0) = 7.0f;  // +Z
  EXPECT_EQ(panorama.show(map).at(32, 16, 0), 7.0f);
  EXPECT_EQ(panorama.show(map).at(48, 16, 0), 0.0f);
  EXPECT_FALSE(LightPanorama({64, 32, Parameterisation::lat_long}).is_cube());
}

class MeshInTheViewer : public testing::Test {
 protected:
  MeshInTheViewer() { state_.view()->move().set_size(160, 120); }
  void expect_picture() {
    state_.view()->settle();
    state_.refresh();
    const Image expected = FieldPictures(field_, {state_.view()->camera()}).picture(state_.light(), 0);
    EXPECT_LT(relative_rmse(state_.radiance(), expected), 1e-4);
  }
  const ReflectanceField field_ = test::unshadowed_field(prt::rabbit_mesh(8));
  ViewState state_{ReflectanceField(field_)};
};

TEST_F(MeshInTheViewer, ShowsWhatTheCameraSees) {
  expect_picture();
  EXPECT_EQ(state_.picture().size(), 4u * 160 * 120);
  state_.view()->move().orbit(70.0, 20.0);
  expect_picture();
  PaintedLight light_source = state_.setup().light_sources[0];
  light_source.x = 0.9;
  state_.setup().light_sources[0] = light_source;
  expect_picture();
  EXPECT_EQ(state_.light_picture().size(),
            4u * state_.panorama().shown().width * state_.panorama().shown().height);
  EXPECT_FALSE(state_.refresh().picture);
}

// An environment's integrals over the field's squares and the light sources' light map make one picture,
// whichever of them changes or is missing.
TEST_F(MeshInTheViewer, AnEnvironmentNeedsNoLightMap) {
  Rng rng{11};
  const auto environment = std::make_shared<const PreparedEnvironment>(
      test::random_light(rng, {64, 32, Parameterisation::lat_long}));
  const auto projector =
      std::make_shared<const EnvironmentProjector>(field_.basis.domain, std::span<const MonitorPlacement>());
  LightSetup& setup = state_.setup();
  setup.environment = environment;
  setup.projector = projector;
  expect_picture();  // with the light sources of the start
  setup.set_turns(0.3);
  expect_picture();
  PaintedLight light_source = setup.light_sources[0];
  light_source.x = 0.8;
  setup.light_sources[0] = light_source;
  expect_picture();
  setup.light_sources.clear();
  setup.ambient = 0.0;
  setup.map_gain = 2.0;
  expect_picture();  // alone
  EXPECT_EQ(state_.share().energy, 1.0);
  const LightMap seen = projector->project(*environment, setup.turn()).light;
  for (std::size_t i = 0; i < seen.radiance.values.size(); ++i)
    ASSERT_NEAR(state_.light().radiance.values[i], 2.0f * seen.radiance.values[i], 1e-5f);
  state_.probe(Box{1, 1, 2, 2});
  state_.refresh();
  state_.probe(std::nullopt);
  setup.set_turns(0.7);
  expect_picture();
  setup.light_sources.push_back(light_source);
  expect_picture();
  setup.set_map(std::nullopt);
  expect_picture();  // the light source alone
}

TEST_F(MeshInTheViewer, APickedVertexStaysPicked) {
  state_.refresh();
  state_.pick(PixelPosition{0, 0});
  EXPECT_FALSE(state_.picked());  // nothing there
  state_.pick(PixelPosition{80, 70});
  state_.refresh();
  ASSERT_TRUE(state_.picked());
  const auto kernels = state_.kernels().size();
  EXPECT_GT(kernels, 10u);  // half of all directions
  state_.view()->move().pan(11.0, 0.0);
  state_.refresh();
  ASSERT_TRUE(state_.picked());
  EXPECT_NEAR(state_.picked()->x, 80 + 11, 4);
  EXPECT_EQ(state_.kernels().size(), kernels);
  state_.view()->move().pan(500.0, 0.0);  // out of the picture, yet not let go
  state_.refresh();
  EXPECT_FALSE(state_.picked());
  state_.view()->move().reset();
  state_.refresh();
  EXPECT_TRUE(state_.picked());
}

}  // namespace
}  // namespace refield
