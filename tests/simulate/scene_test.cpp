// SPDX-License-Identifier: Apache-2.0
#include "simulate/tabletop/scene.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "core/base/errors.h"

namespace refield {
namespace {

using Eigen::Vector3f;
using Shape = ObjectDescription::Shape;

SceneDescription with(ObjectDescription object) {
  SceneDescription scene;
  scene.camera.width = 40;
  scene.camera.height = 30;
  scene.camera.position = {0, 0, 5};
  scene.camera.target = {0, 0, 0};
  scene.camera.vertical_fov_degrees = 90.0;
  scene.monitor.texels = {40, 30, Parameterisation::monitor};
  scene.monitor.centre = {0, 0, -10};
  scene.monitor.facing = {0, 0, 1};
  scene.monitor.width_m = 4.0;
  scene.monitor.height_m = 3.0;
  scene.materials = {MaterialDescription{.name = "it"}};
  object.material = "it";
  scene.objects = {object};
  return scene;
}

ObjectDescription sphere() {
  return {.shape = Shape::sphere};  // of diameter 1
}
ObjectDescription box() {
  return {.shape = Shape::box, .place = {.stretch = {2.0f, 1.0f, 0.5f}}};
}

TEST(TabletopScene, SphereIsHitFromOutsideAndFromWithin) {
  const TabletopScene scene(with(sphere()));
  const auto outside = scene.intersect({{0.3f, 0, 5}, {0, 0, -1}});
  ASSERT_TRUE(outside);
  EXPECT_NEAR(outside->position.z(), 0.4f, 1e-4f);
  EXPECT_LT((outside->shading_normal - Vector3f(0.6f, 0, 0.8f)).norm(), 1e-3f);
  const auto within = scene.intersect({{0, 0, 0}, {1, 0, 0}});
  ASSERT_TRUE(within);
  EXPECT_EQ(within->object, 0);
  EXPECT_NEAR(within->position.x(), 0.5f, 1e-4f);
  EXPECT_GT(within->geometric_normal.x(), 0.99f);  // normals point outwards
}

TEST(TabletopScene, BoxFacesPointOutwardsAndTurnWithIt) {
  const TabletopScene scene(with(box()));
  const Vector3f half(1.0f, 0.5f, 0.25f);
  for (int axis = 0; axis < 3; ++axis)
    for (float side : {-1.0f, 1.0f}) {
      const Vector3f normal = side * Vector3f::Unit(axis);
      const auto hit = scene.intersect(
          {4.0f * normal + Vector3f(0.1f, 0.1f, 0.1f).cwiseProduct(Vector3f::Ones() - normal.cwiseAbs()),
           -normal});
      ASSERT_TRUE(hit);
      EXPECT_LT((hit->geometric_normal - normal).norm(), 1e-5f);
      EXPECT_LT((hit->shading_normal - normal).norm(), 1e-5f);
      EXPECT_NEAR(hit->position[axis], side * half[axis], 1e-5f);
    }
  ObjectDescription turned = box();
  turned.place.turn = {.yaw = 90.0};
  const auto hit = TabletopScene(with(turned)).intersect({{0, 0, 5}, {0, 0, -1}});
  ASSERT_TRUE(hit);
  EXPECT_NEAR(hit->position.z(), 1.0f, 1e-5f);  // its long side now lies along z
}

TEST(TabletopScene, LatheOfASemicircleIsASphere) {
  ObjectDescription lathe{.shape = Shape::lathe};
  for (int i = 0; i <= 24; ++i) {
    const double t = -M_PI / 2 + M_PI * i / 24;
    lathe.profile.emplace_back(std::max(0.0, 0.5 * std::cos(t)), 0.5 * std::sin(t));
  }
  const TabletopScene scene(with(lathe));
  for (const Vector3f& from : {Vector3f(2, 1, 1), Vector3f(-1, 2, 0.5f), Vector3f(0.3f, -2, 1)}) {
    const auto hit = scene.intersect({from, -from.normalized()});
    ASSERT_TRUE(hit);
    EXPECT_NEAR(hit->position.norm(), 0.5f, 2e-3f);
    EXPECT_LT((hit->shading_normal - from.normalized()).norm(), 0.02f);
    EXPECT_GT(hit->geometric_normal.dot(from), 0.0f);
  }
}

TEST(TabletopScene, MonitorPointsAndTexelsAgree) {
  const TabletopScene scene(with(sphere()));
  const MonitorSurface& monitor = scene.monitor();
  EXPECT_NEAR(monitor.texel_area(), 0.01f, 1e-6f);
  // Seen from the front: the first texel lies at the upper left.
  EXPECT_LT((monitor.point(0, 0) - Vector3f(-2, 1.5f, -10)).norm(), 1e-5f);
  for (int y : {0, 7, 29})
    for (int x : {0, 13, 39})
      EXPECT_EQ(monitor.texel_at(monitor.point(static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f)),
                Eigen::Vector2i(x, y));
}

TEST(TabletopScene, OcclusionIsSymmetricAndEndsBeforeItsTarget) {
  const TabletopScene scene(with(sphere()));
  EXPECT_TRUE(scene.occluded({0, 0, 3}, {0, 0, -3}));
  EXPECT_TRUE(scene.occluded({0, 0, -3}, {0, 0, 3}));
  EXPECT_FALSE(scene.occluded({2, 0, 3}, {2, 0, -3}));
  EXPECT_FALSE(scene.occluded({2, 0, 0}, scene.monitor().point(10, 10)));  // the monitor does not hide itself
}

TEST(TabletopScene, CameraLooksAtItsTarget) {
  const TabletopScene scene(with(sphere()));
  EXPECT_LT((scene.camera_ray(20, 15).direction - Vector3f(0, 0, -1)).norm(), 1e-6f);
  const Vector3f top = scene.camera_ray(20, 0).direction;
  EXPECT_NEAR(top.y() / -top.z(), 1.0f, 1e-5f);  // 90° from top to bottom
  EXPECT_LT(scene.camera_ray(0, 15).direction.x(), 0.0f);
}

TEST(TabletopScene, ATurnedCameraSeesItsTargetElsewhere) {
  SceneCamera camera = with(sphere()).camera;
  camera.position = {1, 2, 5};
  const SceneCamera moved = turned(camera, 0.25, -0.5);
  EXPECT_EQ(moved.position, camera.position);
  const Eigen::Vector3d view = moved.target - moved.position, to_target = camera.target - camera.position;
  const Eigen::Vector3d right = view.cross(moved.up).normalized(), down = view.normalized().cross(right);
  const double depth = to_target.dot(view.normalized());
  const double pixels = camera.height / 2.0 / depth;  // 90 degrees from top to bottom
  constexpr double to_first_order = 0.005;            // of the projection of the target on the turned view
  EXPECT_NEAR(to_target.dot(right) * pixels, 0.25, to_first_order);
  EXPECT_NEAR(to_target.dot(down) * pixels, -0.5, to_first_order);
}

TEST(TabletopScene, RefusesUnknownMaterialsAndEmptyShapes) {
  SceneDescription scene = with(sphere());
  scene.objects[0].material = "other";
  EXPECT_THROW(TabletopScene{scene}, InputError);
  EXPECT_THROW(TabletopScene{with({.shape = Shape::lathe, .profile = {{0, 0}, {0, 1}}})}, InputError);
}

}  // namespace
}  // namespace refield
