// SPDX-License-Identifier: Apache-2.0
// Shadows from area lights by occlusion fields: against closed forms, against rays, and where they fail.
#include "simulate/dynamic/field_light.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

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
  DirectLight by_rays(const Mesh& area_lights, int points, std::size_t object = 0) const {
    SceneRays all(rays);
    all.move(scene.poses(0.0));
    return direct_light(scene.objects[object], scene.poses(0.0)[object], transport[object].factors, all,
                        area_points(area_lights, points), eye);
  }
  DirectLight by_fields(const Mesh& area_lights, int points, FieldShadow shadow = FieldShadow::edge,
                        std::size_t object = 0) const {
    std::vector<PlacedObject> placed;
    for (std::size_t o = 0; o < 2; ++o) placed.push_back({&transport[o], scene.poses(0.0)[o]});
    return FieldLight(scene, transport)
        .direct(placed, object, area_points(area_lights, points), eye, shadow,
                HarmonicProduct(transport.front().order));
  }
  /// Radiance of the floor's vertex nearest to its middle.
  float below_ball(const DirectLight& light) const {
    const auto& positions = scene.objects[0].mesh.positions;
    const auto nearest = std::ranges::min_element(positions, {}, [](const auto& p) { return p.norm(); });
    return light.to_eye[static_cast<std::size_t>(nearest - positions.begin())].mean();
  }

  const Eigen::Vector3f eye{0.5f, 1.5f, -3.0f};
  DynamicScene scene;
  std::vector<prt::MeshRays> rays;
  std::vector<ObjectTransport> transport;
};

double energy(const std::vector<Eigen::Array3f>& light) {
  double sum = 0.0;
  for (const auto& value : light) sum += value.matrix().squaredNorm();
  return std::sqrt(sum);
}

/// RMSE of radiance towards the eye, relative.
double difference(DirectLight light, const DirectLight& truth) {
  for (std::size_t v = 0; v < truth.to_eye.size(); ++v) light.to_eye[v] -= truth.to_eye[v];
  return energy(light.to_eye) / energy(truth.to_eye);
}

float sum(const DirectLight& light) {
  float all = 0.0f;
  for (const auto& value : light.to_eye) all += value.sum();
  return all;
}

TEST(FieldLight, UnderABallUnderAnEvenSky) {
  // A ball of radius r whose middle stands h above hides (r/h)² of the cosine-weighted sky; a floor that
  // reflects 0.8 then has radiance 0.8 (1 − (r/h)²).
  const Mesh sky = area_light(sized(prt::sphere_mesh(8), 60.0f), 1.0f);
  for (const float height : {0.6f, 0.8f, 1.2f}) {
    const BallOverFloor scene(5, height);
    const float expected = 0.8f * (1.0f - 0.16f / (height * height));
    const float by_rays = scene.below_ball(scene.by_rays(sky, 2048));
    // 2 048 points, half of them above, are a sky to about one in a hundred; edges are found by five bands
    // to about a degree.
    EXPECT_NEAR(by_rays, expected, 0.02f) << height;
    EXPECT_NEAR(scene.below_ball(scene.by_fields(sky, 2048)), expected, 0.03f) << height;
    // The same blurred twice.
    EXPECT_NEAR(scene.below_ball(scene.by_fields(sky, 2048, FieldShadow::product)), expected, 0.06f)
        << height;
  }
}

TEST(FieldLight, IsThatOfRaysWhereNothingHides) {
  const BallOverFloor scene(4, 50.0f);
  const Mesh area_lights = area_light(sized(prt::plane_mesh(1), 0.7f, {0.3f, 1.5f, -0.2f}), 10.0f);
  const DirectLight by_rays = scene.by_rays(area_lights, 16);
  for (const FieldShadow shadow : {FieldShadow::edge, FieldShadow::product}) {
    const DirectLight by_fields = scene.by_fields(area_lights, 16, shadow);
    // What the floor receives was sampled by 1 024 directions.
    EXPECT_LT(difference(by_fields, by_rays), 0.01);
    EXPECT_LT((by_fields.terms - by_rays.terms).norm(), 0.02f * by_rays.terms.norm());
  }
}

TEST(FieldLight, SoftShadowsAreThoseOfRays) {
  const Mesh area_lights = area_light(sized(prt::plane_mesh(1), 1.6f, {0.3f, 2.2f, -0.3f}), 5.0f);
  double before = 1.0;
  for (const int order : {3, 5, 8}) {
    const BallOverFloor scene(order);
    const DirectLight truth = scene.by_rays(area_lights, 512);
    const double error = difference(scene.by_fields(area_lights, 64), truth);
    EXPECT_LT(error, 0.08) << order;
    EXPECT_LT(error, before + 0.005) << order;
    EXPECT_LT(error, difference(scene.by_fields(area_lights, 64, FieldShadow::product), truth)) << order;
    before = error;
  }
}

TEST(FieldLight, HardShadowsAreBlurredButNotLost) {
  // An area light of a hundredth: fields know where the shadow lies to a fraction of what n = 4 resolves.
  const Mesh small = area_light(sized(prt::plane_mesh(1), 0.02f, {0.3f, 2.2f, -0.3f}), 5e4f);
  const BallOverFloor scene(4), without(4, 50.0f);
  const DirectLight truth = scene.by_rays(small, 4), unshadowed = without.by_rays(small, 4);
  const DirectLight by_edge = scene.by_fields(small, 4);
  const DirectLight by_product = scene.by_fields(small, 4, FieldShadow::product);
  EXPECT_GT(difference(by_edge, truth), 0.05);
  EXPECT_GT(difference(by_product, truth), 1.5 * difference(by_edge, truth));
  for (std::size_t v = 0; v < truth.to_eye.size(); ++v) {
    EXPECT_GE(by_edge.to_eye[v].minCoeff(), 0.0f);
    EXPECT_LE(by_edge.to_eye[v].maxCoeff(), 1.001f * unshadowed.to_eye[v].maxCoeff());
  }
  // As much is hidden in all, and the ball's shadow is as dark.
  const float hidden = sum(unshadowed) - sum(truth);
  EXPECT_NEAR(sum(unshadowed) - sum(by_edge), hidden, 0.2f * hidden);
}

TEST(FieldLight, NothingHidesWhatStandsBeforeIt) {
  const BallOverFloor scene(4, 1.6f), without(4, 50.0f);
  const Mesh below = area_light(sized(prt::plane_mesh(1), 0.3f, {0.0f, 0.7f, 0.0f}), 5.0f);
  EXPECT_EQ(sum(scene.by_fields(below, 16)), sum(without.by_fields(below, 16)));
}

}  // namespace
}  // namespace refield::dynamic
