// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/harmonic_transfer.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <numbers>

#include "core/base/errors.h"
#include "core/light/monitor_placement.h"
#include "tests/simulate/prt/path_comparison.h"
#include "tests/simulate/prt/small_scenes.h"
#include "tests/support/message_of.h"

namespace refield::prt {
namespace {

using refield::test::message_of;

const Material white = {{0.8f, 0.8f, 0.8f}, {0.0f, 0.0f, 0.0f}, 0.0f};
const Material glossy = {{0.2f, 0.3f, 0.2f}, {0.5f, 0.5f, 0.4f}, 10.0f};

test::PathLight distant(const test::HarmonicLight& light) {
  return [&light](const Eigen::Vector3f&, const Eigen::Vector3f& from) { return light(from); };
}

HarmonicTransfer transfer_of(const Scene& scene, const HarmonicOptions& options) {
  HarmonicStatistics statistics;
  return harmonic_transfer(scene, options, statistics);
}

TEST(HarmonicTransfer, OfAConvexBodyIsTheIrradianceConvolution) {
  Scene scene;
  test::add(scene, sphere_mesh(14), {.position = Eigen::Vector3f(1.0f, 2.0f, 3.0f)}, white);
  const HarmonicTransfer transfer = transfer_of(scene, {});
  ASSERT_EQ(transfer.outputs, 1);
  ASSERT_EQ(transfer.channels, 1);
  const double cosine_band[] = {1.0, 2.0 / 3.0, 1.0 / 4.0, 0.0, -1.0 / 24.0};  // over π
  double worst = 0.0;
  std::vector<double> y(25);
  for (std::size_t v = 0; v < scene.mesh.positions.size(); ++v) {
    evaluate_harmonics(5, scene.mesh.normals[v].cast<double>(), y);
    for (int l = 0; l < 5; ++l)
      for (auto i = static_cast<std::size_t>(l * l); i < static_cast<std::size_t>((l + 1) * (l + 1)); ++i)
        worst = std::max(worst, std::abs(transfer.row(v, 0, 0)[i] - cosine_band[l] * y[i]));
  }
  // Triangles hide what lies within half their bend of the horizon, and samples are 2048.
  EXPECT_LT(worst, 1e-3);
  EXPECT_LT((transfer.colours[0] - 0.8f).abs().maxCoeff(), 1e-6f);
}

constexpr double smooth_error = 0.02;  // what the paths' noise, some 0.008, and the mesh may take of it
const dynamic::ReferenceOptions many_paths = {.paths = 8192, .bounces = 7};

TEST(HarmonicTransfer, IsWhatTracedPathsSeeUnderSmoothLight) {
  const Scene scene = test::ball_scene(white);
  const test::HarmonicLight light = test::random_harmonic_light(4, 5);
  HarmonicOptions options{.order = 4};
  const auto all = test::trace_vertices(scene, 19, distant(light), many_paths);
  EXPECT_LT(test::error_of(transfer_of(scene, options), scene, light, all), smooth_error);
  options.until = 1.0;
  const HarmonicTransfer direct = transfer_of(scene, options);
  EXPECT_EQ(direct.channels, 1);
  const auto once = test::trace_vertices(scene, 19, distant(light), {.paths = 8192, .bounces = 0});
  EXPECT_LT(test::error_of(direct, scene, light, once), smooth_error);
  // The test would see it if interreflection were missing.
  EXPECT_GT(test::error_of(direct, scene, light, all), 0.2);
}

TEST(HarmonicTransfer, OfGlossySurfacesIsWhatTracedPathsSee) {
  const Scene scene = test::ball_scene(glossy);
  const test::HarmonicLight light = test::random_harmonic_light(3, 5);
  const HarmonicOptions options{.order = 6, .directions = 1024, .until = 0.01};
  const HarmonicTransfer transfer = transfer_of(scene, options);
  EXPECT_EQ(transfer.outputs, 36);
  const auto traced = test::trace_vertices(scene, 19, distant(light), many_paths);
  EXPECT_LT(test::error_of(transfer, scene, light, traced), smooth_error);
}

/// The Phong lobe that stands for GGX, multiplied by its gain, seen at up to 60 degrees.
TEST(HarmonicTransfer, OfGgxSurfacesIsNearWhatTracedPathsSee) {
  constexpr float roughness = 0.5f, tilt = 1.7f;
  const test::HarmonicLight light = test::random_harmonic_light(3, 5);
  const HarmonicOptions options{.order = 6, .directions = 1024, .until = 0.01};
  const Eigen::Array3f gold(0.95f, 0.7f, 0.4f), dark(0.2f, 0.3f, 0.2f);
  for (const Material& ball : {Material::ggx({0.0f, 0.0f, 0.0f}, gold, roughness),
                               Material::ggx(dark, {0.04f, 0.04f, 0.04f}, roughness)}) {
    const bool metal = (ball.diffuse == 0.0f).all();
    Scene scene = test::ball_scene(ball);
    const auto traced = test::trace_vertices(scene, 19, distant(light), many_paths, tilt);
    const double error = test::error_of(transfer_of(scene, options), scene, light, traced);
    scene.materials[2].roughness = 0.0f;
    const double of_phong = test::error_of(transfer_of(scene, options), scene, light, traced);
    EXPECT_LT(error, metal ? 0.08 : 0.06) << metal;
    EXPECT_GT(of_phong, metal ? 2.0 * error : 1.2 * error) << metal << ' ' << error;
  }
}

/// Harmonics cut the lobe off: the sharper it is the later. By the integral over all directions, no
/// shadows.
TEST(HarmonicTransfer, OfALobeComesNearerTheIntegralByOrder) {
  Scene scene;
  test::add(scene, sphere_mesh(9), {}, {{0.0f, 0.0f, 0.0f}, {0.5f, 0.6f, 0.7f}, 12.0f});
  const test::HarmonicLight light = test::random_harmonic_light(3, 8);
  const auto traced = test::trace_vertices(scene, 5, distant(light), {.paths = 16384, .bounces = 0});
  double before = 1.0;
  for (const int order : {3, 5, 7}) {
    const HarmonicTransfer transfer = transfer_of(scene, {.order = order});
    EXPECT_TRUE((transfer.colours[0] == Eigen::Array3f(0.5f, 0.6f, 0.7f)).all());
    const double error = test::error_of(transfer, scene, light, traced);
    EXPECT_LT(error, before);
    before = error;
  }
  EXPECT_LT(before, 0.01);
}

TEST(HarmonicTransfer, LobeFactorsAreTheLobesMoments) {
  const std::vector<double> factors = lobe_factors(7.5, 5);
  constexpr int steps = 20000;
  for (int l = 0; l < 5; ++l) {
    double sum = 0.0;
    for (int k = 0; k < steps; ++k) {
      const double t = (k + 0.5) / steps;
      sum += std::pow(t, 7.5) * std::legendre(static_cast<unsigned>(l), t) / steps;
    }
    EXPECT_NEAR(factors[static_cast<std::size_t>(l)], 9.5 * sum, 1e-7);
  }
}

TEST(HarmonicTransfer, PassesBringLessAndLess) {
  HarmonicStatistics statistics;
  const HarmonicOptions options{.order = 2, .directions = 512, .until = 0.01};
  harmonic_transfer(test::ball_scene(white), options, statistics);
  const auto& energy = statistics.pass_energy;
  ASSERT_GT(energy.size(), 3u);
  EXPECT_GT(energy[0], 0.5);
  for (std::size_t pass = 1; pass < energy.size(); ++pass) EXPECT_LT(energy[pass], 0.5 * energy[pass - 1]);
  EXPECT_LT(energy.back(), 0.01 * energy[0]);
  EXPECT_GE(energy[energy.size() - 2], 0.01 * energy[0]);
}

TEST(HarmonicTransfer, TurnsWithSceneAndLight) {
  const Scene scene = test::ball_scene(white);
  const Eigen::Matrix3d turn = rotation_of(EulerAngles{.yaw = 50.0, .pitch = 20.0, .roll = -130.0});
  Scene turned = scene;
  for (auto* vectors : {&turned.mesh.positions, &turned.mesh.normals})
    for (auto& vector : *vectors) vector = turn.cast<float>() * vector;
  const test::HarmonicLight light = test::random_harmonic_light(5, 2);
  const test::HarmonicLight turned_light{5, harmonic_rotation(5, turn) * light.coefficients};
  const HarmonicTransfer here = transfer_of(scene, {}), there = transfer_of(turned, {});
  test::RelativeError error;
  for (std::size_t v = 0; v < scene.mesh.positions.size(); ++v)
    error.add(test::radiance(there, turned, turned_light, v, turned.mesh.normals[v]),
              test::radiance(here, scene, light, v, scene.mesh.normals[v]));
  EXPECT_LT(error.value(), 5e-3);  // other samples fall on other sides of edges
}

TEST(HarmonicTransfer, DoesNotDependOnThreads) {
  const Scene scene = test::ball_scene(glossy);
  const HarmonicOptions options{.order = 3, .directions = 256, .until = 0.1};
  const HarmonicTransfer many = transfer_of(scene, options);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  EXPECT_EQ(many.values, transfer_of(scene, options).values);
}

TEST(HarmonicTransfer, AsAFieldIsRelitByMaps) {
  const test::HarmonicLight light = test::random_harmonic_light(3, 7);
  constexpr int resolution = 16;
  LightMap map{Image(resolution, cube_faces * resolution, 3), Parameterisation::cube};
  for (int y = 0; y < map.radiance.height; ++y)
    for (int x = 0; x < resolution; ++x) {
      const Eigen::Array3f texel = light(cube_direction(x + 0.5, y + 0.5, resolution).cast<float>());
      for (int c = 0; c < 3; ++c) map.radiance.at(x, y, c) = texel[c];
    }
  for (const Material& ball : {white, glossy}) {
    const Scene scene = test::ball_scene(ball);
    const HarmonicTransfer transfer = transfer_of(scene, {.order = 3, .directions = 512, .until = 0.1});
    const FieldRows rows = harmonic_field(scene, transfer, resolution);
    const ReflectanceField field = test::field_of(rows);
    const Image outputs = field.relight(map);
    const auto count = static_cast<std::size_t>(transfer.outputs);
    ASSERT_EQ(field.mesh->outputs(), scene.mesh.positions.size() * count);
    test::RelativeError error;
    for (std::size_t v = 0; v < scene.mesh.positions.size(); ++v) {
      std::vector<double> over(count, 1.0);  // looked at straight
      if (count > 1) evaluate_harmonics(3, scene.mesh.normals[v].cast<double>(), over);
      Eigen::Array3f seen = Eigen::Array3f::Zero();
      for (std::size_t i = 0; i < count; ++i)
        seen += static_cast<float>(over[i]) *
                Eigen::Map<const Eigen::Array3f>(&outputs.values[3 * pixel_of_output(v * count + i)]);
      error.add(seen * field.mesh->colours[v],
                test::radiance(transfer, scene, light, v, scene.mesh.normals[v]));
    }
    EXPECT_LT(error.value(), 0.01);  // of the map's texels
    // Asked for a few rows at a time it is the same.
    const SparseTransfer some = rows.rows({5, 9});
    const std::uint64_t first = field.transfer.row_start[5 * output_image_width];
    for (std::size_t k = 0; k < some.entries(); ++k)
      ASSERT_EQ(some.weight[3 * k], field.transfer.weight[3 * (first + k)]);
  }
}

TEST(HarmonicTransfer, RefusesWhatCannotBe) {
  const Scene scene = test::ball_scene(white);
  const auto refuse = [&](const HarmonicOptions& options) {
    return message_of<InputError>([&] { transfer_of(scene, options); });
  };
  EXPECT_THAT(refuse({.order = 9}), testing::HasSubstr("order 9: give 2 to 8"));
  EXPECT_THAT(refuse({.directions = 3}), testing::HasSubstr("directions 3"));
  EXPECT_THAT(refuse({.until = 0.0}), testing::HasSubstr("until"));
  EXPECT_THAT(refuse({.radius = 1.0}), testing::HasSubstr("give at least"));
  EXPECT_THAT(message_of<InputError>([] { transfer_of({}, {}); }), testing::HasSubstr("no vertices"));
}

}  // namespace
}  // namespace refield::prt
