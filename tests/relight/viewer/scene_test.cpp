// SPDX-License-Identifier: Apache-2.0
// What the viewer of moving scenes is about, without its window: dragging, picking, and what is outdated
// when.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <numbers>

#include "core/base/errors.h"
#include "relight/viewer/scene/scene_state.h"
#include "simulate/geometry/mesh_shapes.h"
#include "simulate/geometry/place_mesh.h"

namespace refield {
namespace {

const PinholeCamera camera = {{0, 2, -4}, {0, 0, 0}, {0, 1, 0}, 40.0f, 120, 90};

Eigen::Vector2f seen_at(const PinholeCamera& from, const Eigen::Vector3f& point) {
  return *from.image_point(point);
}

TEST(DraggedShift, FollowsThePointerOverTheFloor) {
  const Eigen::Vector3f from(0.3f, 0.5f, -0.2f), to(-0.6f, 0.5f, 0.7f);
  const Eigen::Vector3f shift =
      dragged_shift(camera, from, seen_at(camera, from), seen_at(camera, to), DragPlane::level);
  EXPECT_LT((shift - (to - from)).norm(), 1e-4f);
}

TEST(DraggedShift, GoesUprightWithShift) {
  const Eigen::Vector3f from(0.3f, 0.5f, -0.2f), to(0.3f, 1.1f, -0.2f);
  const Eigen::Vector3f shift =
      dragged_shift(camera, from, seen_at(camera, from), seen_at(camera, to), DragPlane::upright);
  EXPECT_LT((shift - (to - from)).norm(), 1e-4f);
  const Eigen::Vector3f aside = dragged_shift(camera, from, {60, 45}, {80, 45}, DragPlane::upright);
  EXPECT_EQ(aside.x(), 0.0f);
  EXPECT_EQ(aside.z(), 0.0f);
}

TEST(DraggedShift, StaysFiniteWherePixelsTellNoPlace) {
  PinholeCamera low = camera;
  low.position = {0, 0.01f, -4};
  const Eigen::Vector3f point(0.0f, 0.0f, 0.0f);
  // Along the floor it goes with the picture's plane,
  const Eigen::Vector3f up = dragged_shift(low, point, {60, 45}, {60, 35}, DragPlane::level);
  EXPECT_GT(up.y(), 0.1f);
  EXPECT_LT(std::abs(up.z()), 0.01f);
  // from straight above too,
  PinholeCamera above = camera;
  above.position = {0, 4, -1e-3f};
  above.up = {0, 0, 1};
  EXPECT_TRUE(dragged_shift(above, point, {60, 45}, {70, 45}, DragPlane::upright).allFinite());
  // and beyond the horizon no further than ten times the distance.
  const Eigen::Vector3f far = dragged_shift(camera, {0, 1.2f, 0}, {60, 60}, {60, -4000}, DragPlane::level);
  EXPECT_TRUE(far.allFinite());
  EXPECT_LE(far.norm(), 10.01f * (Eigen::Vector3f(0, 1.2f, 0) - camera.position).norm());
}

/// Two balls, of which the second one moves, and a small area light; "light" is each thing's own number plus
/// one.
MovingScene three_things(int& lit) {
  MovingScene scene;
  scene.name = "three";
  scene.things = {
      {.name = "left"}, {.name = "right", .moves = true}, {.name = "area light", .is_area_light = true}};
  scene.duration = 2.0;
  scene.camera = {{0, 0, -6}, {0, 0, 0}, {0, 1, 0}, 40.0f, 120, 90};
  scene.middle = [](std::size_t thing, double time) {
    const auto x = static_cast<float>(thing == 0 ? -1.0 : thing == 1 ? 1.0 + 0.5 * time : 0.0);
    return Eigen::Vector3f(x, thing == 2 ? 1.5f : 0.0f, 0.0f);
  };
  scene.light = [&lit, middle = scene.middle](const SceneMoment& moment, SceneFrame& frame) {
    ++lit;
    const Mesh ball = prt::sphere_mesh(6);
    frame = {};
    frame.first_vertex = {0};
    for (std::size_t thing = 0; thing < 3; ++thing) {
      Eigen::Isometry3f pose = Eigen::Isometry3f::Identity();
      pose.linear() *= 1.4f;  // a radius of 0.7
      pose.translation() = middle(thing, moment.time) + moment.handling[thing].shift;
      prt::append(ball, pose, frame.mesh);
      const auto radiance =
          static_cast<float>((1.0 + static_cast<double>(thing)) * moment.handling[thing].gain);
      frame.radiance.resize(frame.mesh.positions.size(), Eigen::Array3f::Constant(radiance));
      frame.first_vertex.push_back(static_cast<std::uint32_t>(frame.mesh.positions.size()));
    }
  };
  return scene;
}

TEST(SceneState, PicksThingsAndPutsThem) {
  int lit = 0;
  SceneState state(three_things(lit));
  state.refresh();
  const auto at = [&](const Eigen::Vector3f& point) {
    const Eigen::Vector2f p = seen_at(state.view().camera(), point);
    return state.seen_at(static_cast<int>(p.x()), static_cast<int>(p.y()));
  };
  ASSERT_TRUE(at({-1, 0, 0}) && at({1, 0, 0}) && at({0, 1.5f, 0}));
  EXPECT_EQ(at({-1, 0, 0})->thing, 0u);
  EXPECT_EQ(at({1, 0, 0})->thing, 1u);
  EXPECT_EQ(at({0, 1.5f, 0})->thing, 2u);
  EXPECT_FALSE(at({0, -1.5f, 0}));
  EXPECT_FALSE(state.seen_at(-1, 4));
  EXPECT_LT((at({1, 0, 0})->point - Eigen::Vector3f(1, 0, 0)).norm(), 0.75f);
  state.put(1, {0, -1.5f, 0});
  state.refresh();
  ASSERT_TRUE(at({0, -1.5f, 0}));
  EXPECT_EQ(at({0, -1.5f, 0})->thing, 1u);
  state.set_time(2.0);  // its own motion goes on from there
  EXPECT_LT((state.middle(1) - Eigen::Vector3f(1, -1.5f, 0)).norm(), 1e-5f);
  state.start_over();
  EXPECT_EQ(state.middle(1), Eigen::Vector3f(1, 0, 0));
  EXPECT_EQ(state.time(), 0.0);
}

TEST(SceneState, LightsAnewOnlyWhereSomethingChanged) {
  int lit = 0;
  SceneState state(three_things(lit));
  state.refresh();
  const int first = lit;
  EXPECT_FALSE(state.refresh().picture);
  state.set_tone({2.0, ToneOperator::clip});
  EXPECT_TRUE(state.refresh().picture);
  state.view().settle();
  EXPECT_TRUE(state.refresh().picture);  // finer, by the same light
  EXPECT_EQ(lit, first);
  state.view().move().orbit(5.0, 0.0);
  state.refresh();
  EXPECT_EQ(lit, first + 1);  // what is glossy looks otherwise from elsewhere
  state.handle(0, {});
  state.set_bounces(state.bounces());
  state.set_time(0.0);
  state.refresh();
  EXPECT_EQ(lit, first + 1);
  state.set_bounces(100);
  EXPECT_EQ(state.bounces(), SceneState::max_bounces);
  state.refresh();
  EXPECT_EQ(lit, first + 2);
}

TEST(SceneState, TimeBeginsAnewAndIsExposedWithoutAreaLights) {
  int lit = 0;
  SceneState state(three_things(lit));
  state.set_time(100.0);
  EXPECT_EQ(state.time(), 2.0);
  state.advance(0.5);
  EXPECT_NEAR(state.time(), 0.5, 1e-12);
  EXPECT_NEAR(state.tone().exposure, 0.5, 0.01);  // of radiances 1, 2 and, of the area light, 3
  EXPECT_THROW(SceneState(MovingScene{}), InputError);
}

}  // namespace
}  // namespace refield
