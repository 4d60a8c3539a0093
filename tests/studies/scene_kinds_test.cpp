// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/chart/pixel_kinds.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace refield::chart {
namespace {

using Kind = MaterialDescription::Kind;
using Shape = ObjectDescription::Shape;

/// A floor seen from straight above, a monitor on the right, and things on the floor.
SceneDescription floor_with(std::vector<ObjectDescription> things) {
  SceneDescription scene;
  scene.camera.width = 20;
  scene.camera.height = 20;
  scene.camera.position = {0, 10, 0.01};
  scene.camera.target = {0, 0, 0};
  scene.camera.vertical_fov_degrees = 11.4;  // about two metres of floor
  scene.monitor.texels = {16, 12, Parameterisation::monitor};
  scene.monitor.centre = {3, 1, 0};
  scene.monitor.facing = {-1, 0, 0};
  scene.monitor.width_m = 1.6;
  scene.monitor.height_m = 1.2;
  scene.materials = {MaterialDescription{.name = "matt", .kind = Kind::diffuse},
                     MaterialDescription{.name = "coat", .kind = Kind::glossy},
                     MaterialDescription{.name = "mirror", .kind = Kind::mirror},
                     MaterialDescription{.name = "glass", .kind = Kind::glass}};
  things.insert(
      things.begin(),
      ObjectDescription{.shape = Shape::plane, .material = "matt", .place = {.stretch = {1.8f, 1.0f, 1.8f}}});
  scene.objects = std::move(things);
  return scene;
}

ObjectDescription ball(const char* material, float x, float z, float radius) {
  return {.shape = Shape::sphere,
          .material = material,
          .place = {.size = 2.0f * radius, .position = Eigen::Vector3f(x, radius, z)}};
}

std::string kind_at(const PixelKinds& kinds, int x, int y) {
  const int label = kinds.labels[static_cast<std::size_t>(y) * kinds.width + x];
  return label == 0 ? "" : kinds.names[static_cast<std::size_t>(label - 1)];
}

TEST(SceneKinds, AnOpenFloorIsDiffuseAndItsSurroundingsAreOfNoKind) {
  const PixelKinds kinds = scene_kinds(TabletopScene(floor_with({})));
  EXPECT_EQ(kind_at(kinds, 10, 10), "diffuse");
  EXPECT_EQ(kind_at(kinds, 0, 0), "");
}

TEST(SceneKinds, MaterialsAreToldApart) {
  const PixelKinds kinds = scene_kinds(
      TabletopScene(floor_with({ball("mirror", -0.5f, -0.5f, 0.25f), ball("glass", -0.5f, 0.5f, 0.25f),
                                ball("coat", 0.5f, 0.0f, 0.25f)})));
  // 0.1 m a pixel; x to the right, z downwards.
  EXPECT_EQ(kind_at(kinds, 5, 5), "refraction");
  EXPECT_EQ(kind_at(kinds, 5, 15), "refraction");
  EXPECT_EQ(kind_at(kinds, 15, 10), "glossy");
  EXPECT_GT(std::ranges::count(kinds.labels, 5), 0) << "outlines are mixed";
}

TEST(SceneKinds, AnObjectsShadowHasAHardEdgeWhereItHidesPartOfTheMonitor) {
  // A plate stands between the monitor and the left of the floor and hides the monitor's lower half from it.
  const ObjectDescription plate{
      .shape = Shape::box,
      .material = "matt",
      .place = {.stretch = {0.02f, 0.3f, 0.6f}, .position = Eigen::Vector3f(0.6f, 0.15f, 0.0f)}};
  const PixelKinds kinds = scene_kinds(TabletopScene(floor_with({plate})));
  EXPECT_EQ(kind_at(kinds, 4, 10), "hard_shadow") << "the lower half of the monitor is hidden";
  EXPECT_EQ(kind_at(kinds, 13, 10), "diffuse") << "close behind the plate nothing of the monitor is seen";
  EXPECT_EQ(kind_at(kinds, 18, 10), "diffuse") << "on the monitor's side of the plate";
  EXPECT_EQ(kind_at(kinds, 10, 2), "diffuse") << "beside the plate";
}

}  // namespace
}  // namespace refield::chart
