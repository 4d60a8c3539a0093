// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cstdio>

#include "tests/simulate/prt/cluster_errors.h"

namespace refield::prt {
namespace {

using test::cluster;
using test::error_of;
using test::outputs_of;

/// Relative RMSE of a view under small area lights, of its glossy pixels and of the others.
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
    lights.push_back(test::area_lights(resolution, 3, {{x, y}}));
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
  std::printf("%s, epsilon %g: error of highlights %.3f, of diffuse pixels %.3f, %.0f entries per pixel\n",
              similarity == Similarity::group ? "groups" : "all outputs", epsilon, error.glossy,
              error.diffuse,
              static_cast<double>(statistics.entries) / static_cast<double>(layout.place_of_pixel.size()));
  return error;
}

TEST(ClusterHighlights, OfFewPixelsAmongManyDiffuseOnesAreKeptByCutsOfGroupsWithFewerEntries) {
  constexpr double good_diffuse = 0.06;   // both are as good on diffuse pixels
  constexpr double good_highlight = 0.1;  // the norm over all pixels is only printed: about 0.4
  const GlossyError all = glossy_error(Similarity::all_outputs, 1e-3);
  const GlossyError groups = glossy_error(Similarity::group, 2e-3);
  EXPECT_LT(all.diffuse, good_diffuse);
  EXPECT_LT(groups.diffuse, good_diffuse);
  EXPECT_LT(groups.glossy, good_highlight);
  EXPECT_LT(groups.entries, all.entries);
}

TEST(ClusterHighlights, OfGroupsFindHighlightsFarNarrowerThanTheSquaresTheyBeginWith) {
  constexpr double good = 0.2;
  constexpr int resolution = 256;
  Scene scene;
  test::add(scene, plane_mesh(1), test::stretched(100.0f),
            {.diffuse = {0.1f, 0.1f, 0.1f}, .specular = {0.1f, 0.1f, 0.1f}, .exponent = 5000.0f});
  scene.camera = PinholeCamera{
      .position = {0.0f, 1.0f, -2.0f}, .vertical_field_of_view_degrees = 0.5f, .width = 8, .height = 8};
  // An area light of two texels, a degree wide, seen mirrored in the middle of the view; the lobe is two
  // degrees wide.
  const Eigen::Vector2d area_light = cube_position({0.0, 1.0, 2.0}, resolution);
  const LightMap light = test::area_lights(
      resolution, 2, {{static_cast<int>(area_light.x()), static_cast<int>(area_light.y())}});
  const ReflectanceField field =
      cluster(scene, {.relighting = Relighting::image, .resolution = resolution, .epsilon = 1e-3});
  EXPECT_LT(error_of(field, scene, Relighting::image, light), good);
}

}  // namespace
}  // namespace refield::prt
