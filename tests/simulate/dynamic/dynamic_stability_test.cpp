// SPDX-License-Identifier: Apache-2.0
// Where precomputed light between moving objects is asked for more than it was made for.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "simulate/dynamic/dynamic_light.h"
#include "simulate/geometry/mesh_shapes.h"

namespace refield::dynamic {
namespace {

struct Moving {
  explicit Moving(const Brdf& brdf, bool fields = false) {
    Mesh ball = prt::sphere_mesh(6);
    MovingObject object{"ball", ball, brdf, {}};
    object.motion.path = {{0.0, {0, 0, 0}}};
    scene.objects = {object, object};
    scene.objects.push_back({"floor", prt::plane_mesh(12), {}, {}});
    for (auto& point : scene.objects.back().mesh.positions) point *= 4.0f;
    scene.objects.back().motion.path = {{0.0, {0, -0.5f, 0}}};
    TransportOptions options;
    options.fields = fields;
    options.functions = 8;  // times up to 16 terms of a surface
    options.rings = 5;
    options.shells = 8;
    options.directions = 256;
    options.factors.largest = 16;
    rays.reserve(3);
    for (const MovingObject& each : scene.objects) {
      rays.emplace_back(each.mesh);
      transport.push_back(object_transport(each, rays.back(), options));
    }
    light.emplace(scene, rays, transport);
  }

  void replace_first(const Mesh& mesh) {
    scene.objects[0].mesh = mesh;
    rays[0] = prt::MeshRays(scene.objects[0].mesh);
    light.emplace(scene, rays, transport);
  }

  /// Radiance with the second ball and the area light moved.
  std::vector<Eigen::Array3f> at(const Eigen::Vector3f& second, const Eigen::Vector3f& area_light_at,
                                 const FrameOptions& frame = {}) {
    std::vector<Pose> poses = scene.poses(0.0);
    poses[1].translation() = second;
    Mesh area_light = prt::plane_mesh(1);
    for (auto& point : area_light.positions) point = 0.3f * point + area_light_at;
    for (auto& colour : area_light.colours) colour.setConstant(10.0f);
    light->solve(poses, area_light, {0, 1, -4}, frame);
    return light->radiance(0, light->bounces());
  }

  /// The largest step of the balls' mean indirect light as the second comes in `steps` from 2 to where both
  /// are nearly in one place; there, all vertices come to the surface at once.
  float largest_step(int steps) {
    float before = -1.0f, largest = 0.0f, most = 0.0f;
    for (int i = 0; i < steps; ++i) {
      at({2.0f - 2.0f * static_cast<float>(i) / static_cast<float>(steps), 0.0f, 0.0f}, {0.3f, 2.0f, -0.5f});
      float mean = 0.0f;
      for (const auto& value : light->radiance(1, light->bounces())) mean += value.mean();
      if (before >= 0.0f) largest = std::max(largest, std::abs(mean - before));
      most = std::max(most, mean);
      before = mean;
    }
    return largest / most;
  }

  DynamicScene scene;
  std::vector<prt::MeshRays> rays;
  std::vector<ObjectTransport> transport;
  std::optional<DynamicLight> light;
};

void expect_sound(const std::vector<Eigen::Array3f>& radiance, float most) {
  for (const auto& value : radiance) {
    ASSERT_TRUE(value.isFinite().all());
    ASSERT_GE(value.minCoeff(), 0.0f);
    ASSERT_LT(value.maxCoeff(), most);
  }
}

TEST(DynamicStability, ObjectsThatTouchOverlapAndEncloseOneAnother) {
  for (const bool fields : {false, true}) {
    Moving moving(Brdf{}, fields);
    // Apart, touching, overlapping, in one place, sunk into the floor, far away.
    for (const Eigen::Vector3f& place :
         {Eigen::Vector3f(1.5f, 0, 0), Eigen::Vector3f(1.0f, 0, 0), Eigen::Vector3f(0.5f, 0, 0),
          Eigen::Vector3f(0, 0, 0), Eigen::Vector3f(1.0f, -0.5f, 0), Eigen::Vector3f(1e4f, 0, 0)})
      expect_sound(moving.at(place, {0.3f, 2.0f, -0.5f}), 20.0f);
  }
}

TEST(DynamicStability, ALampWithinAnObjectAndOnTheFloor) {
  Moving moving{Brdf{}};
  // The area light's radiance is 10: nothing that reflects four fifths of it can shine brighter for long.
  for (const Eigen::Vector3f& place :
       {Eigen::Vector3f(0, 0, 0), Eigen::Vector3f(0, 0.52f, 0), Eigen::Vector3f(1.0f, -0.5f, 0)})
    expect_sound(moving.at({1.5f, 0, 0}, place), 60.0f);
}

TEST(DynamicStability, ShadowsByOcclusionFields) {
  Moving moving(Brdf{}, true);
  const FrameOptions frame{.direct_by_fields = true};
  // Objects apart, touching, in one place, sunk into the floor, far away.
  for (const Eigen::Vector3f& place :
       {Eigen::Vector3f(1.5f, 0, 0), Eigen::Vector3f(1.0f, 0, 0), Eigen::Vector3f(0, 0, 0),
        Eigen::Vector3f(1.0f, -0.5f, 0), Eigen::Vector3f(1e4f, 0, 0)})
    expect_sound(moving.at(place, {0.3f, 2.0f, -0.5f}, frame), 20.0f);
  // The area light in a ball, upon one, with its points at the floor's vertices.
  for (const Eigen::Vector3f& place :
       {Eigen::Vector3f(0, 0, 0), Eigen::Vector3f(0, 0.52f, 0), Eigen::Vector3f(1.0f, -0.5f, 0)})
    expect_sound(moving.at({1.5f, 0, 0}, place, frame), 60.0f);
}

TEST(DynamicStability, ExtremeMaterials) {
  for (const float exponent : {1.0f, 1000.0f}) {
    Brdf brdf;
    brdf.diffuse.setZero();
    brdf.specular.setConstant(0.9f);
    brdf.lobe = Lobe::phong;
    brdf.exponent = exponent;
    Moving moving(brdf, true);
    expect_sound(moving.at({1.1f, 0, 0}, {0.3f, 2.0f, -0.5f}), 1e4f);
    expect_sound(moving.at({1.1f, 0, 0}, {0.3f, 2.0f, -0.5f}, {.direct_by_fields = true}), 1e4f);
    expect_sound(Moving(brdf).at({1.1f, 0, 0}, {0.3f, 2.0f, -0.5f}), 1e4f);
  }
}

TEST(DynamicStability, AFanOfThousandsOfTriangles) {
  Brdf brdf;
  brdf.specular.setConstant(0.5f);
  brdf.lobe = Lobe::phong;
  brdf.exponent = 10.0f;
  Moving moving(brdf);
  // The first ball becomes a disc whose middle has 20 000 neighbours: pairs of them would take 25 GB.
  constexpr std::uint32_t corners = 20'000;
  Mesh disc;
  disc.positions.emplace_back(0.0f, 0.0f, 0.0f);
  for (std::uint32_t i = 0; i < corners; ++i) {
    const auto angle = static_cast<float>(i) * 2.0f * std::numbers::pi_v<float> / static_cast<float>(corners);
    disc.positions.emplace_back(std::sin(angle), 0.0f, std::cos(angle));
    disc.triangles.push_back({0, 1 + i, 1 + (i + 1) % corners});
  }
  disc.normals.assign(disc.positions.size(), Eigen::Vector3f::UnitY());
  disc.colours.assign(disc.positions.size(), Eigen::Array3f::Ones());
  moving.replace_first(disc);
  expect_sound(moving.at({0.2f, 0.6f, 0}, {0.3f, 2.0f, -0.5f}), 1e4f);
}

TEST(DynamicStability, NoPoppingAsOneObjectEntersAnother) {
  // Balls that approach and then overlap: light between them changes by no more than this share of its
  // largest from one of a hundred steps to the next.
  EXPECT_LT(Moving(Brdf{}, true).largest_step(100), 0.05f);
  // By rays: a vertex has 16, and the balls are coarse.
  EXPECT_LT(Moving(Brdf{}).largest_step(100), 0.1f);
}

}  // namespace
}  // namespace refield::dynamic
