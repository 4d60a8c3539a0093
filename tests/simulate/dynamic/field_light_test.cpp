// SPDX-License-Identifier: Apache-2.0
// Shadows from area lights by occlusion fields: against closed forms, against rays, and where they fail.
#include "simulate/dynamic/dynamic_light.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <span>

#include "simulate/geometry/mesh_shapes.h"

namespace refield::dynamic {
namespace {

Mesh sized(Mesh mesh, float size, const Eigen::Vector3f& position = {0, 0, 0}) {
  for (auto& point : mesh.positions) point = size * point + position;
  return mesh;
}

Mesh area_light(Mesh mesh, float radiance) {
  for (auto& colour : mesh.colours) colour = Eigen::Array3f::Constant(radiance);
  return mesh;
}

/// A diffuse floor, 3 × 3, and a ball of diameter 0.8 above its middle.
struct BallOverFloor {
  explicit BallOverFloor(int order, float height = 0.8f) {
    scene.objects.push_back({"floor", sized(prt::plane_mesh(20), 3.0f), {}, {}});
    scene.objects.push_back({"ball", sized(prt::sphere_mesh(7), 0.8f), {}, {}});
    scene.objects[0].motion.path = {{0.0, {0, 0, 0}}};
    scene.objects[1].motion.path = {{0.0, {0, height, 0}}};
    TransportOptions options;
    options.fields = true;
    options.order = order;
    options.functions = 1;
    options.rings = 6;
    options.shells = 10;
    rays.reserve(2);
    for (const MovingObject& each : scene.objects) {
      rays.emplace_back(each.mesh);
      transport.push_back(object_transport(each, rays.back(), options));
    }
  }
  /// Radiance of the floor, which is diffuse, [vertices]: its one term seen from above.
  Eigen::VectorXf radiance(const TermLight& light) const {
    Eigen::Array3f g;
    transport[0].factors.outgoing({0, 0, 1}, std::span(&g, 1));
    return g[0] * light.col(0);
  }
  Eigen::VectorXf by_rays(const Mesh& area_lights, int points) const {
    SceneRays all(rays);
    all.move(scene.poses(0.0));
    return radiance(direct_light(scene.objects[0], scene.poses(0.0)[0], transport[0].factors, all,
                                 area_points(area_lights, points), {0.5f, 1.5f, -3.0f})
                        .terms);
  }
  Eigen::VectorXf by_fields(const Mesh& area_lights, int points) const {
    std::vector<PlacedObject> placed;
    for (std::size_t o = 0; o < 2; ++o) placed.push_back({&transport[o], scene.poses(0.0)[o]});
    return radiance(
        FieldLight(scene, transport)
            .direct(placed, 0, area_points(area_lights, points), HarmonicProduct(transport.front().order)));
  }
  /// Radiance of the vertex nearest to the floor's middle.
  float below_ball(const Eigen::VectorXf& light) const {
    const auto& positions = scene.objects[0].mesh.positions;
    const auto nearest = std::ranges::min_element(positions, {}, [](const auto& p) { return p.norm(); });
    return light[nearest - positions.begin()];
  }

  DynamicScene scene;
  std::vector<prt::MeshRays> rays;
  std::vector<ObjectTransport> transport;
};

/// RMSE, relative.
double difference(const Eigen::VectorXf& light, const Eigen::VectorXf& truth) {
  return (light - truth).norm() / truth.norm();
}

TEST(FieldLight, UnderABallUnderAnEvenSky) {
  // A ball of radius r whose middle stands h above hides (r/h)² of the cosine-weighted sky; a floor that
  // reflects 0.8 then has radiance 0.8 (1 − (r/h)²).
  const Mesh sky = area_light(sized(prt::sphere_mesh(8), 60.0f), 1.0f);
  for (const float height : {0.6f, 0.8f, 1.2f}) {
    const BallOverFloor scene(5, height);
    const float expected = 0.8f * (1.0f - 0.16f / (height * height));
    const float by_rays = scene.below_ball(scene.by_rays(sky, 2048));
    // 2 048 points, half of them above, are a sky to about one in a hundred.
    EXPECT_NEAR(by_rays, expected, 0.02f) << height;
    // Blurred twice by five bands.
    EXPECT_NEAR(scene.below_ball(scene.by_fields(sky, 2048)), expected, 0.06f) << height;
  }
}

TEST(FieldLight, IsThatOfRaysWhereNothingHides) {
  const BallOverFloor scene(4, 50.0f);
  const Mesh area_lights = area_light(sized(prt::plane_mesh(1), 0.7f, {0.3f, 1.5f, -0.2f}), 10.0f);
  // What the floor receives was sampled by 1 024 directions.
  EXPECT_LT(difference(scene.by_fields(area_lights, 16), scene.by_rays(area_lights, 16)), 0.02);
}

TEST(FieldLight, SoftShadowsComeNearerToThoseOfRaysWithTheOrder) {
  const Mesh area_lights = area_light(sized(prt::plane_mesh(1), 1.6f, {0.3f, 2.2f, -0.3f}), 5.0f);
  double before = 1.0;
  for (const int order : {3, 5, 8}) {
    const BallOverFloor scene(order);
    const double error = difference(scene.by_fields(area_lights, 64), scene.by_rays(area_lights, 512));
    EXPECT_LT(error, before) << order;
    before = error;
  }
  EXPECT_LT(before, 0.07);
}

TEST(FieldLight, HardShadowsAreLostInTheBlur) {
  // An area light of a hundredth.
  const Mesh small = area_light(sized(prt::plane_mesh(1), 0.02f, {0.3f, 2.2f, -0.3f}), 5e4f);
  const BallOverFloor scene(4), without(4, 50.0f);
  const Eigen::VectorXf truth = scene.by_rays(small, 4), unshadowed = without.by_rays(small, 4);
  const Eigen::VectorXf light = scene.by_fields(small, 4);
  EXPECT_GT(difference(light, truth), 0.2);
  EXPECT_GE(light.minCoeff(), 0.0f);
  EXPECT_LE(light.maxCoeff(), 1.001f * unshadowed.maxCoeff());
  // A part of what the ball hides is hidden.
  const float hidden = unshadowed.sum() - truth.sum();
  EXPECT_NEAR(unshadowed.sum() - light.sum(), 0.65f * hidden, 0.15f * hidden);
}

TEST(FieldLight, NothingHidesWhatStandsBeforeIt) {
  const BallOverFloor scene(4, 1.6f), without(4, 50.0f);
  const Mesh below = area_light(sized(prt::plane_mesh(1), 0.3f, {0.0f, 0.7f, 0.0f}), 5.0f);
  EXPECT_EQ(scene.by_fields(below, 16), without.by_fields(below, 16));
}

}  // namespace
}  // namespace refield::dynamic
