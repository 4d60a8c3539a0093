// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/clusters.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <csignal>
#include <numeric>

#include "core/errors.h"
#include "core/interrupt.h"
#include "core/rng.h"
#include "simulate/prt/cube_quadtree.h"
#include "simulate/prt/integrate.h"
#include "tests/simulate/prt/small_scenes.h"
#include "tests/support/message_of.h"
#include "tests/support/random_data.h"

namespace refield::prt {
namespace {

using refield::test::message_of;
using test::field_of;

constexpr Similarity both[] = {Similarity::all_outputs, Similarity::group};

ReflectanceField cluster(const Scene& scene, const ClusterOptions& options,
                         ClusterStatistics* figures = nullptr) {
  ClusterStatistics statistics;
  ReflectanceField field = field_of(cluster_transfer(scene, options, statistics));
  if (figures) *figures = statistics;
  return field;
}

/// Outputs of a relit image in the order of integrate_lights().
std::vector<Eigen::Array3d> outputs_of(const Image& image, const OutputLayout& layout) {
  std::vector<Eigen::Array3d> outputs(layout.outputs.size(), Eigen::Array3d::Zero());
  for (std::size_t pixel = 0; pixel < layout.place_of_pixel.size(); ++pixel)
    if (layout.place_of_pixel[pixel] != OutputLayout::none)
      for (int c = 0; c < 3; ++c) outputs[layout.place_of_pixel[pixel]][c] = image.values[3 * pixel + c];
  return outputs;
}

/// Relative RMSE of the outputs that count.
template <class Counts>
double error_of(const std::vector<Eigen::Array3d>& outputs, const std::vector<Eigen::Array3d>& exact,
                const Counts& counts) {
  double difference = 0.0, all = 0.0;
  for (std::size_t i = 0; i < exact.size(); ++i) {
    if (!counts(i)) continue;
    difference += (outputs[i] - exact[i]).square().sum();
    all += exact[i].square().sum();
  }
  return std::sqrt(difference / all);
}

/// Of a field under a light, against the sum over all lights.
double error_of(const ReflectanceField& field, const Scene& scene, Relighting relighting,
                const LightMap& light) {
  const OutputLayout layout = layout_of(scene, relighting);
  const TransferSamples transfer(scene, {.relighting = relighting}, layout.outputs);
  return error_of(outputs_of(field.relight(light), layout), integrate_lights(transfer, {&light, 1})[0],
                  [](std::size_t) { return true; });
}

TEST(Clusters, OfAnOpenPlaneGiveOneUnderWhiteLight) {
  const Scene scene = test::plane_scene();
  LightMap white{Image(32, 192, 3, 1.0f), Parameterisation::cube};
  for (const Similarity similarity : both) {
    const ReflectanceField field =
        cluster(scene, {.similarity = similarity, .resolution = 32, .epsilon = 1e-3});
    const Image image = field.relight(white);
    // Sampling of cos where it reaches zero inside squares: a plane's horizon lies on edges of squares.
    constexpr double quadrature = 0.01;
    for (std::size_t v = 0; v < scene.mesh.positions.size(); ++v)
      EXPECT_NEAR(image.values[3 * pixel_of_output(v)], 1.0, quadrature) << name_of(similarity);
  }
}

TEST(Clusters, WithoutToleranceEqualTheSumOverAllLights) {
  constexpr double bytes = 0.004;  // a weight is rounded to 1/255 of its group's largest
  const Scene scene = test::hare_scene();
  Rng rng(3);
  for (const int resolution : {1, 8, 11})  // 11: no power of two
    for (const Similarity similarity : both) {
      const ReflectanceField field =
          cluster(scene, {.similarity = similarity, .resolution = resolution, .epsilon = 0.0});
      const LightMap light = refield::test::random_light(rng, cube_domain(resolution));
      EXPECT_LT(error_of(field, scene, Relighting::geometry, light), bytes)
          << resolution << name_of(similarity);
    }
}

TEST(Clusters, OfAViewWithoutToleranceEqualTheSumOverAllLights) {
  constexpr double bytes = 0.004;
  const Scene scene = test::glossy_scene();
  Rng rng(4);
  const LightMap light = refield::test::random_light(rng, cube_domain(9));
  for (const Similarity similarity : both) {
    const ReflectanceField field = cluster(
        scene, {.relighting = Relighting::image, .similarity = similarity, .resolution = 9, .epsilon = 0.0});
    EXPECT_TRUE(field.mesh.empty());
    EXPECT_LT(error_of(field, scene, Relighting::image, light), bytes) << name_of(similarity);
  }
}

TEST(Clusters, ErrFurtherTheMoreIsLetPass) {
  const Scene scene = test::hare_scene();
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
      EXPECT_GT(error, last) << name_of(similarity) << epsilon;
      EXPECT_LT(statistics.clusters, last_clusters) << name_of(similarity) << epsilon;
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
  const Scene scene = test::hare_scene();
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
  const Scene scene = test::hare_scene();
  ClusterStatistics statistics;
  cluster(scene, {.similarity = Similarity::all_outputs, .resolution = 32, .epsilon = 0.0}, &statistics);
  EXPECT_EQ(statistics.lights, 6.0 * 32 * 32);
  EXPECT_LT(statistics.peak_vectors,
            80u);  // 9 for a square, 27 more for each of log2 32 quadrisections at most
}

TEST(Clusters, GrowFarSlowerThanTheNumberOfLights) {
  constexpr double growth = 1.5;  // while the lights are sixteen times as many
  const Scene scene = test::hare_scene();
  for (const auto& [similarity, epsilon] :
       {std::pair{Similarity::all_outputs, 1.5e-3}, std::pair{Similarity::group, 1e-3}}) {
    ClusterStatistics coarse, fine;
    cluster(scene, {.similarity = similarity, .resolution = 64, .epsilon = epsilon}, &coarse);
    cluster(scene, {.similarity = similarity, .resolution = 256, .epsilon = epsilon}, &fine);
    EXPECT_GT(coarse.clusters, 200u) << name_of(similarity);
    EXPECT_LT(static_cast<double>(fine.entries), growth * static_cast<double>(coarse.entries))
        << name_of(similarity);
    EXPECT_LT(static_cast<double>(fine.clusters), growth * static_cast<double>(coarse.clusters))
        << name_of(similarity);
  }
}

/// Relative RMSE of a view under small lamps, of its glossy pixels and of the others.
struct GlossyError {
  double glossy = 0.0, diffuse = 0.0;
  std::uint64_t entries = 0;
};

GlossyError glossy_error(Similarity similarity, double epsilon) {
  constexpr int resolution = 64;
  const Scene scene = test::glossy_scene();
  ClusterStatistics statistics;
  const ReflectanceField field = cluster(scene,
                                         {.relighting = Relighting::image,
                                          .similarity = similarity,
                                          .resolution = resolution,
                                          .epsilon = epsilon},
                                         &statistics);
  const OutputLayout layout = layout_of(scene, Relighting::image);
  const TransferSamples transfer(scene, {.relighting = Relighting::image}, layout.outputs);
  std::vector<LightMap> lights;  // that the ball mirrors and the plane sees
  for (const auto& [x, y] : {std::pair{20, 140}, {40, 150}, {32, 160}, {12, 330}, {50, 335}})
    lights.push_back(test::lamps(resolution, 3, {{x, y}}));
  const auto exact = integrate_lights(transfer, lights);
  std::vector<std::uint32_t> apart(16 * layout.outputs.size(),
                                   OutputLayout::none);  // each a group of its own
  for (std::size_t i = 0; i < layout.outputs.size(); ++i) apart[16 * i] = layout.outputs[i];
  const TransferSamples alone(scene, {.relighting = Relighting::image}, apart);
  const auto is_glossy = [&](std::size_t i) { return !alone.lobes(i, 1.0f).empty(); };
  GlossyError error{.entries = statistics.entries};
  for (std::size_t l = 0; l < lights.size(); ++l) {
    const auto outputs = outputs_of(field.relight(lights[l]), layout);
    const auto share = 1.0 / static_cast<double>(lights.size());
    error.glossy += share * error_of(outputs, exact[l], is_glossy);
    error.diffuse += share * error_of(outputs, exact[l], [&](std::size_t i) { return !is_glossy(i); });
  }
  std::printf("%s, epsilon %g: error of highlights %.3f, of diffuse pixels %.3f, %.0f entries a pixel\n",
              name_of(similarity).data(), epsilon, error.glossy, error.diffuse,
              static_cast<double>(statistics.entries) / static_cast<double>(layout.place_of_pixel.size()));
  return error;
}

TEST(Clusters, OfLightsMissHighlightsOfFewPixelsAmongManyDiffuseOnesAndCutsOfGroupsDoNot) {
  constexpr double good_diffuse = 0.06;     // both are as good on diffuse pixels
  constexpr double missed_highlight = 0.3;  // with the norm over all pixels
  constexpr double good_highlight = 0.1;    // with cuts of groups
  const GlossyError all = glossy_error(Similarity::all_outputs, 1e-3);
  const GlossyError groups = glossy_error(Similarity::group, 4e-3);
  EXPECT_LT(all.diffuse, good_diffuse);
  EXPECT_LT(groups.diffuse, good_diffuse);
  EXPECT_GT(all.glossy, missed_highlight);
  EXPECT_LT(groups.glossy, good_highlight);
  EXPECT_LT(groups.entries, all.entries);
}

TEST(Clusters, OfGroupsFindHighlightsFarNarrowerThanTheSquaresTheyBeginWith) {
  constexpr double good = 0.2;
  constexpr int resolution = 256;
  Scene scene;
  test::add(scene, plane_mesh(1), test::stretched(100.0f),
            {.diffuse = {0.1f, 0.1f, 0.1f}, .specular = {0.1f, 0.1f, 0.1f}, .exponent = 5000.0f});
  scene.camera = PinholeCamera{
      .position = {0.0f, 1.0f, -2.0f}, .vertical_field_of_view_degrees = 0.5f, .width = 8, .height = 8};
  // A lamp of two texels, a degree wide, seen mirrored in the middle of the view; the lobe is two degrees
  // wide.
  const Eigen::Vector2d lamp = cube_position({0.0, 1.0, 2.0}, resolution);
  const LightMap light =
      test::lamps(resolution, 2, {{static_cast<int>(lamp.x()), static_cast<int>(lamp.y())}});
  const ReflectanceField field =
      cluster(scene, {.relighting = Relighting::image, .resolution = resolution, .epsilon = 1e-3});
  EXPECT_LT(error_of(field, scene, Relighting::image, light), good);
}

TEST(Clusters, DoNotDependOnTheNumberOfThreads) {
  const Scene scene = test::hare_scene();
  for (const Similarity similarity : both) {
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
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const Scene scene = test::hare_scene();
  for (const Similarity similarity : both)
    EXPECT_EXIT(
        {
          install_interrupt_handler();
          std::raise(SIGINT);
          try {
            cluster(scene, {.similarity = similarity, .resolution = 1024, .epsilon = 1e-6});
          } catch (const Interrupted&) {
            std::_Exit(130);
          }
        },
        testing::ExitedWithCode(130), "");
}

TEST(Clusters, OfAMeshCarryItsColoursTimesTheirReflectance) {
  const Scene scene = test::hare_scene();
  const ReflectanceField field = cluster(scene, {.resolution = 8, .epsilon = 0.1});
  ASSERT_EQ(field.mesh.colours.size(), scene.mesh.positions.size());
  for (std::size_t v = 0; v < field.mesh.colours.size(); ++v)
    EXPECT_TRUE((field.mesh.colours[v] ==
                 scene.mesh.colours[v] * scene.materials[scene.material_of_vertex[v]].diffuse)
                    .all());
}

TEST(Clusters, RefuseWhatTheyCannotDo) {
  const auto refusal = [](const Scene& scene, const ClusterOptions& options) {
    return message_of<InputError>([&] { cluster(scene, options); });
  };
  const Scene hare = test::hare_scene();
  EXPECT_NE(refusal(hare, {.resolution = 4097}).find("4097"), std::string::npos);
  EXPECT_NE(refusal(hare, {.resolution = 0}).find("1 to 4096"), std::string::npos);
  EXPECT_NE(refusal(hare, {.samples = 1}).find("2 to 16"), std::string::npos);
  EXPECT_NE(refusal(hare, {.epsilon = -1.0}).find("-1"), std::string::npos);
  EXPECT_NE(refusal(hare, {.epsilon = std::nan("")}).find("nan"), std::string::npos);
  EXPECT_NE(refusal(hare, {.relighting = Relighting::image}).find("camera"), std::string::npos);
  EXPECT_NE(refusal(test::glossy_scene(), {}).find("glossy"), std::string::npos);
  EXPECT_NE(refusal({}, {}).find("no triangles"), std::string::npos);
}

}  // namespace
}  // namespace refield::prt
