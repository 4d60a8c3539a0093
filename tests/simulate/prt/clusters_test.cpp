// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/clusters.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>

#include "core/base/errors.h"
#include "core/base/rng.h"
#include "tests/simulate/prt/cluster_errors.h"
#include "tests/support/interruption.h"
#include "tests/support/message_of.h"
#include "tests/support/random_data.h"

namespace refield::prt {
namespace {

using refield::test::message_of;
using test::cluster;
using test::error_of;

constexpr Similarity all_ways[] = {Similarity::all_outputs, Similarity::group};

TEST(Clusters, OfAnOpenPlaneGiveOneUnderWhiteLight) {
  const Scene scene = test::plane_scene();
  LightMap white{Image(32, 192, 3, 1.0f), Parameterisation::cube};
  for (const Similarity similarity : all_ways) {
    const ReflectanceField field =
        cluster(scene, {.similarity = similarity, .resolution = 32, .epsilon = 1e-3});
    const Image image = field.relight(white);
    // Sampling of cos where it reaches zero inside squares: a plane's horizon lies on edges of squares.
    constexpr double quadrature = 0.01;
    for (std::size_t v = 0; v < scene.mesh.positions.size(); ++v)
      EXPECT_NEAR(image.values[3 * pixel_of_output(v)], 1.0, quadrature) << static_cast<int>(similarity);
  }
}

// Transfer that is linear in the direction needs few kernels and has no error but that of bytes: a sun beside
// the horizon reached a plane 4 % too dark where squares had the mean of the cosine.
TEST(Clusters, OfAnOpenPlaneAreExactUnderALowSun) {
  const Scene scene = test::plane_scene();
  Rng rng(2);
  for (const int resolution : {64, 60}) {  // 60: odd halves
    ClusterStatistics statistics;
    const ReflectanceField field = cluster(scene, {.resolution = resolution, .epsilon = 1e-3}, &statistics);
    EXPECT_LE(statistics.clusters, 60u);
    const Eigen::Vector3d up = scene.mesh.normals[0].cast<double>();
    for (int i = 0; i < 20; ++i) {
      LightMap light{Image(resolution, 6 * resolution, 3), Parameterisation::cube};
      const auto x = static_cast<int>(rng.below(static_cast<std::uint64_t>(resolution)));
      int y = 0;  // of the texels in that column the lowest that is above the horizon
      double least = 2.0;
      for (int row = 0; row < 6 * resolution; ++row) {
        const double sine = cube_direction(x + 0.5, row + 0.5, resolution).dot(up);
        if (sine > 0.0 && sine < least) {
          least = sine;
          y = row;
        }
      }
      light.radiance.at(x, y, 1) = 1e4f;
      EXPECT_LT(error_of(field, scene, Relighting::geometry, light), 2e-3);
    }
  }
}

TEST(Clusters, AddNoNegativeLight) {
  const ReflectanceField field = cluster(test::rabbit_scene(), {.resolution = 64, .epsilon = 3e-4});
  ASSERT_FALSE(field.basis.vector_boxes.empty());
  EXPECT_TRUE(std::ranges::all_of(field.transfer.weight, [](float weight) { return weight >= 0.0f; }));
  // Fits are zero at a corner at least, where a texel is not quite.
  constexpr float rounding = -2e-3f;
  Rng rng(6);
  for (int i = 0; i < 50; ++i) {
    LightMap light{Image(64, 6 * 64, 3), Parameterisation::cube};
    light.radiance.values[rng.below(light.radiance.values.size())] =
        1.0f / static_cast<float>(cube_solid_angle(32, 32, 64));
    EXPECT_GE(std::ranges::min(field.relight(light).values), rounding);
  }
}

TEST(Clusters, HaveFunctionsOfTheCornersOfSquares) {
  const Box box{3, 17, 6, 20};
  const auto corners = corners_of(box, 8);
  const auto functions = corner_functions(box, 8);
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j) EXPECT_NEAR(functions[i].dot(corners[j]), i == j ? 1.0 : 0.0, 1e-12);
  EXPECT_LT((corners[0] - cube_direction(3, 17, 8)).norm(), 1e-12);
  EXPECT_LT((corners[3] - cube_direction(6, 20, 8)).norm(), 1e-12);
}

TEST(Clusters, WithoutToleranceEqualTheSumOverAllLights) {
  constexpr double bytes = 0.004;  // a weight is rounded to 1/255 of its group's largest
  const Scene scene = test::rabbit_scene();
  Rng rng(3);
  for (const int resolution : {1, 8, 11})  // 11: no power of two
    for (const Similarity similarity : all_ways) {
      const ReflectanceField field =
          cluster(scene, {.similarity = similarity, .resolution = resolution, .epsilon = 0.0});
      const LightMap light = refield::test::random_light(rng, cube_domain(resolution));
      EXPECT_LT(error_of(field, scene, Relighting::geometry, light), bytes)
          << resolution << " " << static_cast<int>(similarity);
    }
}

TEST(Clusters, OfAViewWithoutToleranceEqualTheSumOverAllLights) {
  constexpr double bytes = 0.004;
  const Scene scene = test::glossy_scene();
  Rng rng(4);
  const LightMap light = refield::test::random_light(rng, cube_domain(9));
  for (const Similarity similarity : all_ways) {
    const ReflectanceField field = cluster(
        scene, {.relighting = Relighting::image, .similarity = similarity, .resolution = 9, .epsilon = 0.0});
    EXPECT_FALSE(field.mesh);
    EXPECT_LT(error_of(field, scene, Relighting::image, light), bytes) << static_cast<int>(similarity);
  }
}

TEST(Clusters, ErrFurtherTheMoreIsLetPass) {
  const Scene scene = test::rabbit_scene();
  Rng rng(5);
  const LightMap light = refield::test::random_light(rng, cube_domain(32));
  for (const auto& [similarity, first] :
       {std::pair{Similarity::all_outputs, 1e-3}, std::pair{Similarity::group, 1e-4}}) {
    double last = 0.0;
    std::uint64_t last_clusters = ~0ull;
    for (const double epsilon : {first, 3 * first, 9 * first}) {
      ClusterStatistics statistics;
      const ReflectanceField field =
          cluster(scene, {.similarity = similarity, .resolution = 32, .epsilon = epsilon}, &statistics);
      const double error = error_of(field, scene, Relighting::geometry, light);
      EXPECT_GT(error, last) << static_cast<int>(similarity) << " " << epsilon;
      EXPECT_LT(statistics.clusters, last_clusters) << static_cast<int>(similarity) << " " << epsilon;
      last = error;
      last_clusters = statistics.clusters;
    }
  }
}

/// The largest left side of eq. 11 of a square's samples: corners, middles of edges and the middle.
double left_side_of_eq_11(const TransferSamples& transfer, std::size_t outputs, const Box& box,
                          int resolution) {
  std::vector<std::vector<float>> vectors;
  const auto places = [](int first, int last) {
    std::vector<int> at = {first, first + (last - first - 1) / 2, last - 1};
    at.erase(std::unique(at.begin(), at.end()), at.end());
    return at;
  };
  const std::size_t size = transfer.group_values();
  for (const int y : places(box.y0, box.y1))
    for (const int x : places(box.x0, box.x1)) {
      vectors.emplace_back(transfer.groups() * size);
      for (std::size_t g = 0; g < transfer.groups(); ++g)
        transfer.evaluate(g, cube_direction(x + 0.5, y + 0.5, resolution).cast<float>(),
                          std::span(vectors.back()).subspan(g * size, size));
    }
  double largest = 0.0;
  for (const auto& vector : vectors) {
    double square = 0.0;
    for (std::size_t i = 0; i < vector.size(); ++i) {
      double mean = 0.0;
      for (const auto& other : vectors) mean += other[i] / static_cast<double>(vectors.size());
      square += (mean - vector[i]) * (mean - vector[i]);
    }
    largest = std::max(largest, std::sqrt(square) / static_cast<double>(outputs));
  }
  return largest;
}

TEST(Clusters, OfLightsAreThoseSquaresWhoseSamplesAllMeetEquation11) {
  constexpr double epsilon = 3e-3, rounding = 1e-5;
  constexpr int resolution = 64;
  const Scene scene = test::rabbit_scene();
  const std::size_t outputs = scene.mesh.positions.size();
  const ReflectanceField field =
      cluster(scene, {.similarity = Similarity::all_outputs, .resolution = resolution, .epsilon = epsilon});
  const OutputLayout layout = layout_of(scene, Relighting::geometry);
  const TransferSamples transfer(scene, {}, layout.outputs);
  std::size_t joined = 0;
  for (const Box& box : field.basis.boxes) {
    if (box.area() == 1) continue;
    ++joined;
    EXPECT_LT(left_side_of_eq_11(transfer, outputs, box, resolution), epsilon + rounding);
    // And the square of which it is a part does not: 64 is a power of two, so parents are easily found.
    const int side = 2 * box.width();
    const int x = box.x0 / side * side, y = box.y0 / side * side;
    EXPECT_GT(left_side_of_eq_11(transfer, outputs, {x, y, x + side, y + side}, resolution),
              epsilon - rounding);
  }
  EXPECT_GT(joined, 50u);
}

TEST(Clusters, OfLightsTraceNoLightTwiceAndHoldFewVectors) {
  const Scene scene = test::rabbit_scene();
  ClusterStatistics statistics;
  cluster(scene, {.similarity = Similarity::all_outputs, .resolution = 32, .epsilon = 0.0}, &statistics);
  EXPECT_EQ(statistics.lights, 6.0 * 32 * 32);
  EXPECT_LT(statistics.peak_vectors,
            80u);  // 9 for a square, 27 more for each of log2 32 quadrisections at most
}

TEST(Clusters, GrowFarSlowerThanTheNumberOfLights) {
  constexpr double growth = 1.5;  // while the lights are sixteen times as many
  const Scene scene = test::rabbit_scene();
  for (const auto& [similarity, epsilon] :
       {std::pair{Similarity::all_outputs, 1.5e-3}, std::pair{Similarity::group, 1e-3}}) {
    ClusterStatistics coarse, fine;
    cluster(scene, {.similarity = similarity, .resolution = 64, .epsilon = epsilon}, &coarse);
    cluster(scene, {.similarity = similarity, .resolution = 256, .epsilon = epsilon}, &fine);
    EXPECT_GT(coarse.clusters, 200u) << static_cast<int>(similarity);
    EXPECT_LT(static_cast<double>(fine.entries), growth * static_cast<double>(coarse.entries))
        << static_cast<int>(similarity);
    EXPECT_LT(static_cast<double>(fine.clusters), growth * static_cast<double>(coarse.clusters))
        << static_cast<int>(similarity);
  }
}

TEST(Clusters, DoNotDependOnTheNumberOfThreads) {
  const Scene scene = test::rabbit_scene();
  for (const Similarity similarity : all_ways) {
    const ClusterOptions options{.similarity = similarity, .resolution = 32, .epsilon = 0.003};
    const auto once = [&](std::size_t threads) {
      const tbb::global_control control(tbb::global_control::max_allowed_parallelism, threads);
      return cluster(scene, options);
    };
    const ReflectanceField one = once(1), several = once(4);
    EXPECT_EQ(one.basis.boxes, several.basis.boxes);
    EXPECT_EQ(one.transfer.column, several.transfer.column);
    EXPECT_EQ(one.transfer.weight, several.transfer.weight);
    EXPECT_EQ(one.provenance, several.provenance);
  }
}

TEST(Clusters, StopAtCtrlC) {
  const Scene scene = test::rabbit_scene();
  for (const Similarity similarity : all_ways)
    EXPECT_TRUE(refield::test::heeds_interruption([&](const RunContext& run) {
      ClusterStatistics statistics;
      cluster_transfer(scene, {.similarity = similarity, .resolution = 1024, .epsilon = 1e-6}, statistics,
                       run);
    }));
}

TEST(Clusters, OfAMeshCarryItsColoursTimesTheirReflectance) {
  const Scene scene = test::rabbit_scene();
  const ReflectanceField field = cluster(scene, {.resolution = 8, .epsilon = 0.1});
  ASSERT_TRUE(field.mesh);
  ASSERT_EQ(field.mesh->colours.size(), scene.mesh.positions.size());
  for (std::size_t v = 0; v < field.mesh->colours.size(); ++v)
    EXPECT_TRUE((field.mesh->colours[v] ==
                 scene.mesh.colours[v] * scene.materials[scene.material_of_vertex[v]].diffuse)
                    .all());
}

TEST(Clusters, RefuseWhatTheyCannotDo) {
  const auto refusal = [](const Scene& scene, const ClusterOptions& options) {
    return message_of<InputError>([&] { cluster(scene, options); });
  };
  const Scene rabbit = test::rabbit_scene();
  EXPECT_NE(refusal(rabbit, {.resolution = 4097}).find("4097"), std::string::npos);
  EXPECT_NE(refusal(rabbit, {.resolution = 0}).find("1 to 4096"), std::string::npos);
  EXPECT_NE(refusal(rabbit, {.samples = 1}).find("2 to 16"), std::string::npos);
  EXPECT_NE(refusal(rabbit, {.epsilon = -1.0}).find("-1"), std::string::npos);
  EXPECT_NE(refusal(rabbit, {.epsilon = std::nan("")}).find("nan"), std::string::npos);
  EXPECT_NE(refusal(rabbit, {.relighting = Relighting::image}).find("camera"), std::string::npos);
  EXPECT_NE(refusal(test::glossy_scene(), {}).find("glossy"), std::string::npos);
  EXPECT_NE(refusal({}, {}).find("no triangles"), std::string::npos);
}

}  // namespace
}  // namespace refield::prt
