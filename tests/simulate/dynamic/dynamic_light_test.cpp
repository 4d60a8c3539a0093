// SPDX-License-Identifier: Apache-2.0
// Light in moving scenes against paths, and where objects stand in each other's way.
#include "simulate/dynamic/dynamic_light.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "bench/studies/dynamic/bounce_reference.h"
#include "core/base/rng.h"
#include "simulate/dynamic/glossy_sums.h"
#include "simulate/geometry/mesh_shapes.h"

namespace refield::dynamic {
namespace {

MovingObject object(Mesh mesh, float size, const Eigen::Vector3f& position, const Eigen::Array3f& diffuse) {
  for (auto& point : mesh.positions) point *= size;
  MovingObject result{"", std::move(mesh), {}, {}};
  result.brdf.diffuse = diffuse;
  result.motion.path = {{0.0, position}};
  return result;
}

Mesh area_light(const Eigen::Vector3f& position, float radiance) {
  Mesh mesh = prt::plane_mesh(1);
  for (auto& point : mesh.positions) point = 0.5f * point + position;
  for (auto& colour : mesh.colours) colour = Eigen::Array3f::Constant(radiance);
  return mesh;
}

/// A ball over a floor.
DynamicScene ball_over_floor(const Brdf& ball) {
  DynamicScene scene;
  scene.objects.push_back(object(prt::sphere_mesh(8), 0.8f, {0.0f, 0.6f, 0.0f}, {0.8f, 0.2f, 0.1f}));
  scene.objects.back().brdf = ball;
  scene.objects.push_back(object(prt::plane_mesh(24), 3.0f, {0, 0, 0}, {0.7f, 0.7f, 0.7f}));
  return scene;
}

Brdf red() {
  Brdf brdf;
  brdf.diffuse = {0.8f, 0.2f, 0.1f};
  return brdf;
}

TransportOptions quick(bool fields = false) {
  TransportOptions options;
  options.fields = fields;
  options.functions = 12;  // times the terms of a surface
  options.rings = 6;
  options.shells = 10;
  options.directions = 384;
  return options;
}

class Prepared {
 public:
  explicit Prepared(DynamicScene described, TransportOptions options = quick())
      : scene(std::move(described)) {
    rays.reserve(scene.objects.size());
    for (const MovingObject& each : scene.objects) {
      rays.emplace_back(each.mesh);
      transport.push_back(object_transport(each, rays.back(), options));
    }
    light = std::make_unique<DynamicLight>(scene, rays, transport);
  }
  DynamicScene scene;
  std::vector<prt::MeshRays> rays;
  std::vector<ObjectTransport> transport;
  std::unique_ptr<DynamicLight> light;
};

const Eigen::Vector3f eye(0.5f, 1.5f, -3.0f);

/// Relative RMSE of one bounce, or of all (bounce < 0), at every `step`th vertex that faces the eye.
double error_against_paths(Prepared& prepared, const Mesh& area_lights, int bounce, int step, int paths,
                           const FrameOptions& frame = {}) {
  const std::vector<Pose> poses = prepared.scene.poses(0.0);
  prepared.light->solve(poses, area_lights, eye, frame);
  SceneRays rays(prepared.rays);
  rays.move(poses);
  std::vector<PathStart> starts;
  std::vector<std::size_t> number;
  std::size_t before = 0;
  for (std::uint32_t o = 0; o < prepared.scene.objects.size(); ++o) {
    const Mesh& mesh = prepared.scene.objects[o].mesh;
    for (std::uint32_t v = 0; v < mesh.positions.size(); ++v)
      if (v % static_cast<std::uint32_t>(step) == 0 &&
          mesh.normals[v].dot(eye - poses[o] * mesh.positions[v]) > 0.0f) {
        starts.push_back(path_start(prepared.scene, poses, o, v, eye));
        number.push_back(before + v);
      }
    before += mesh.positions.size();
  }
  const auto points = area_points(area_lights, 1024);
  const auto reference = trace_bounces(prepared.scene, rays, poses, {.area_lights = points}, starts,
                                       {.paths = paths, .bounces = 3});
  const auto radiance =
      bounce < 0 ? prepared.light->radiance(0, 3) : prepared.light->radiance(bounce, bounce);
  double error = 0.0, energy = 0.0;
  for (std::size_t i = 0; i < starts.size(); ++i) {
    Eigen::Array3f truth = Eigen::Array3f::Zero();
    for (int b = std::max(bounce, 0); b <= (bounce < 0 ? 3 : bounce); ++b)
      truth += reference[static_cast<std::size_t>(b)][i];
    error += (radiance[number[i]] - truth).matrix().squaredNorm();
    energy += truth.matrix().squaredNorm();
  }
  return std::sqrt(error / energy);
}

Brdf glossy() {
  Brdf brdf = red();
  brdf.diffuse = {0.3f, 0.2f, 0.1f};
  brdf.specular = {0.5f, 0.5f, 0.5f};
  brdf.lobe = Lobe::phong;
  brdf.exponent = 10.0f;
  return brdf;
}

TEST(DynamicLightTest, AgreesWithPaths) {
  const Mesh area_lights = area_light({0.3f, 2.5f, -0.5f}, 10.0f);
  for (const bool fields : {false, true}) {
    Prepared prepared(ball_over_floor(red()), quick(fields));
    EXPECT_LT(error_against_paths(prepared, area_lights, 0, 9, 256), 0.05);
    EXPECT_LT(error_against_paths(prepared, area_lights, 1, 9, 2048), fields ? 0.2 : 0.1);
    EXPECT_LT(error_against_paths(prepared, area_lights, -1, 9, 1024), 0.05);
  }
}

TEST(DynamicLightTest, GlossyAgreesWithPaths) {
  const Mesh area_lights = area_light({0.3f, 2.5f, -0.5f}, 10.0f);
  for (const bool fields : {false, true}) {
    Prepared prepared(ball_over_floor(glossy()), quick(fields));
    EXPECT_LT(error_against_paths(prepared, area_lights, 1, 9, 2048), fields ? 0.3 : 0.15);
    EXPECT_LT(error_against_paths(prepared, area_lights, -1, 9, 1024), 0.06);
  }
}

TEST(DynamicLightTest, MoreRaysLeaveLessError) {
  Prepared prepared(ball_over_floor(glossy()));
  const Mesh area_lights = area_light({0.3f, 2.5f, -0.5f}, 10.0f);
  const auto error = [&](int rays) {
    return error_against_paths(prepared, area_lights, 1, 9, 4096, {.rays = rays});
  };
  const double few = error(3), many = error(48);
  EXPECT_LT(many, 0.6 * few);
}

/// Mean light of one bounce over mean light by paths, of the floor's vertices for which `chosen` holds.
template <class Chosen>
double ratio_to_paths(Prepared& prepared, const Mesh& area_lights, const Chosen& chosen) {
  const std::vector<Pose> poses = prepared.scene.poses(0.0);
  prepared.light->solve(poses, area_lights, eye, {});
  SceneRays rays(prepared.rays);
  rays.move(poses);
  std::vector<PathStart> starts;
  const Mesh& floor = prepared.scene.objects[0].mesh;
  for (std::uint32_t v = 0; v < floor.positions.size(); ++v)
    if (chosen(floor.positions[v])) starts.push_back(path_start(prepared.scene, poses, 0, v, eye));
  const auto points = area_points(area_lights, 256);
  const auto reference = trace_bounces(prepared.scene, rays, poses, {.area_lights = points}, starts,
                                       {.paths = 1024, .bounces = 1});
  const auto radiance = prepared.light->radiance(1, 1);
  double ours = 0.0, theirs = 0.0;
  for (std::size_t i = 0; i < starts.size(); ++i) {
    ours += static_cast<double>(radiance[starts[i].vertex].sum());
    theirs += static_cast<double>(reference[1][i].sum());
  }
  return ours / theirs;
}

TEST(DynamicLightTest, LightIsRightWhereObjectsTouch) {
  // A wall on a floor, and a ball that lies on it. Fields know light near an object only on their spheres.
  const auto described = [] {
    DynamicScene scene;
    scene.objects.push_back(object(prt::plane_mesh(40), 3.0f, {0, 0, 0}, {0.7f, 0.7f, 0.7f}));
    scene.objects.push_back(object(prt::plane_mesh(20), 2.0f, {0.0f, 1.0f, 1.0f}, {0.8f, 0.2f, 0.2f}));
    scene.objects.back().motion.turns = {{0.0, {.pitch = -90.0}}};
    scene.objects.push_back(object(prt::sphere_mesh(8), 0.6f, {-0.5f, 0.3f, -0.3f}, {0.8f, 0.8f, 0.8f}));
    return scene;
  };
  const Mesh area_lights = area_light({0.3f, 2.5f, -0.8f}, 10.0f);
  const auto at_wall = [](const Eigen::Vector3f& at) {
    return std::abs(at.x()) < 0.8f && at.z() > 0.85f && at.z() < 1.0f;
  };
  const auto around_ball = [](const Eigen::Vector3f& at) {
    return (at - Eigen::Vector3f(-0.5f, 0.0f, -0.3f)).norm() < 0.25f;
  };
  Prepared by_rays(described());
  EXPECT_NEAR(ratio_to_paths(by_rays, area_lights, at_wall), 1.0, 0.1);
  EXPECT_NEAR(ratio_to_paths(by_rays, area_lights, around_ball), 1.0, 0.1);
  Prepared by_fields(described(), quick(true));
  const double worst = std::max(std::abs(ratio_to_paths(by_fields, area_lights, at_wall) - 1.0),
                                std::abs(ratio_to_paths(by_fields, area_lights, around_ball) - 1.0));
  EXPECT_GT(worst, 0.2) << "why rays are the default";
}

TEST(DynamicLightTest, AVertexInAnotherObjectIsLitAsTheSurfaceBesideIt) {
  Mesh mesh = prt::plane_mesh(2);
  const std::vector<Eigen::Vector3f> starts = ray_starts(mesh);
  for (std::size_t v = 0; v < starts.size(); ++v) {
    const Eigen::Vector3f& at = mesh.positions[v];
    EXPECT_LT((starts[v] - at).norm(), 0.02f);
    EXPECT_EQ(starts[v].y(), at.y());
    if (at.cwiseAbs().maxCoeff() > 0.4f) {
      EXPECT_LT(starts[v].cwiseAbs().maxCoeff(), 0.4999f);
    }
  }
}

TEST(DynamicLightTest, SharesOfRaysAddUpAsWrittenOut) {
  Rng rng(3);
  constexpr std::size_t width = 48, places = 20, count = 7;
  std::vector<float> h(places * width), sent(4 * 30), sums(3 * width, 1.0f), expected = sums;
  for (float& each : h) each = static_cast<float>(rng.uniform());
  for (float& each : sent) each = static_cast<float>(rng.uniform());
  std::vector<std::uint32_t> seen;
  std::vector<RayShare> shares;
  for (std::size_t i = 0; i < count; ++i) {
    seen.push_back(static_cast<std::uint32_t>(rng.below(30)));
    shares.push_back({static_cast<std::uint16_t>(rng.below(places)), static_cast<std::uint16_t>(100 * i)});
    for (std::size_t c = 0; c < 3; ++c)
      for (std::size_t k = 0; k < width; ++k)
        expected[c * width + k] +=
            static_cast<float>(shares[i].weight) * sent[4 * seen[i] + c] * h[shares[i].place * width + k];
  }
  add_ray_shares(seen.data(), shares.data(), count, sent.data(), h.data(), width, sums.data());
  for (std::size_t i = 0; i < sums.size(); ++i) EXPECT_NEAR(sums[i], expected[i], 1e-5f * expected[i]) << i;
}

TEST(DynamicLightTest, ColoursBleed) {
  Prepared prepared(ball_over_floor(red()));
  prepared.light->solve(prepared.scene.poses(0.0), area_light({0.0f, 2.5f, -1.5f}, 10.0f), eye, {});
  const auto bounced = prepared.light->radiance(1, 1);
  Eigen::Array3f floor = Eigen::Array3f::Zero();
  for (std::size_t v = prepared.scene.objects[0].mesh.positions.size(); v < bounced.size(); ++v)
    floor += bounced[v];
  // White light that a red ball throws on a grey floor has the ball's colour.
  EXPECT_NEAR(floor[1] / floor[0], 0.25f, 0.02f);
  EXPECT_NEAR(floor[2] / floor[0], 0.125f, 0.01f);
}

TEST(DynamicLightTest, IsLinearInAreaLights) {
  Prepared prepared(ball_over_floor(red()));
  const auto solve = [&](float radiance) {
    prepared.light->solve(prepared.scene.poses(0.0), area_light({0.3f, 2.5f, 0.0f}, radiance), eye, {});
    return prepared.light->radiance(0, 3);
  };
  const auto one = solve(1.0f), three = solve(3.0f);
  for (std::size_t v = 0; v < one.size(); ++v)
    EXPECT_LT((three[v] - 3.0f * one[v]).abs().maxCoeff(), 1e-4f + 1e-3f * three[v].maxCoeff());
}

TEST(DynamicLightTest, AThirdObjectHidesLightThatBounced) {
  DynamicScene scene;
  // A white wall, lit; a floor; a ball between wall and floor's far part.
  scene.objects.push_back(object(prt::plane_mesh(20), 3.0f, {0, 0, 0}, {0.7f, 0.7f, 0.7f}));
  scene.objects.push_back(object(prt::plane_mesh(20), 2.0f, {0.0f, 1.0f, 1.5f}, {0.8f, 0.8f, 0.8f}));
  scene.objects.back().motion.turns = {{0.0, {.pitch = -90.0}}};
  scene.objects.push_back(object(prt::sphere_mesh(6), 0.8f, {0.0f, 0.45f, 0.2f}, {0.05f, 0.05f, 0.05f}));
  Prepared prepared(std::move(scene), quick(true));
  // The ball's own shadow falls onto the floor, not onto the wall.
  const auto behind_ball = [&](float ball_height) {
    std::vector<Pose> poses = prepared.scene.poses(0.0);
    poses[2].translation().y() = ball_height;
    prepared.light->solve(poses, area_light({0.0f, 2.0f, -1.0f}, 10.0f), eye, {});
    const auto light = prepared.light->radiance(1, 1);
    float sum = 0.0f;
    const Mesh& floor = prepared.scene.objects[0].mesh;
    for (std::size_t v = 0; v < floor.positions.size(); ++v)
      if (floor.positions[v].head<1>().norm() < 0.3f && std::abs(floor.positions[v].z() + 0.4f) < 0.3f)
        sum += light[v].sum();
    return sum;
  };
  EXPECT_LT(behind_ball(0.45f), 0.9f * behind_ball(1e4f));
}

}  // namespace
}  // namespace refield::dynamic
