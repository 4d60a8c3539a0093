// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "relight/mesh/mesh_view.h"
#include "relight/pack/pack.h"
#include "relight/relighter.h"
#include "simulate/prt/harmonic_transfer.h"
#include "tests/simulate/prt/path_comparison.h"
#include "tests/simulate/prt/small_scenes.h"

namespace refield {
namespace {

constexpr float area_light_radius = 1.0f, area_light_distance = 4.0f;

/// A ball of radiance one, as paths find it.
prt::test::PathLight area_light_at(const Eigen::Vector3f& place) {
  return [place](const Eigen::Vector3f& at, const Eigen::Vector3f& from) -> Eigen::Array3f {
    const Eigen::Vector3f to = place - at;
    const float along = to.dot(from);
    const bool met = along > 0.0f && to.squaredNorm() - along * along < area_light_radius * area_light_radius;
    return Eigen::Array3f::Constant(met ? 1.0f : 0.0f);
  };
}

/// From an area light's mesh over its cube map, a field of harmonics and the relighter to vertices, against
/// paths that meet the area light itself. Harmonics blur what it lights: order 8 comes to some hundredths.
/// Few paths find the area light, that many are needed: 8192 a vertex have noise as large as that error.
TEST(NearAreaLight, LightsTheSceneWhereverItMoves) {
  const prt::Scene scene = prt::test::ball_scene({});
  const Eigen::Vector3f middle = prt::middle(scene.mesh);
  prt::HarmonicStatistics statistics;
  const prt::HarmonicOptions options{.order = 8, .until = 0.01, .radius = area_light_distance};
  TileRelighter relighter(pack_rows(
      prt::harmonic_field(scene, prt::harmonic_transfer(scene, options, statistics), options.map_resolution),
      16));
  const auto picture = [&](const Mesh& area_light) {
    return relighter.relight(emitter_map(area_light, middle, options.map_resolution));
  };
  const std::vector<Eigen::Array3f> reflectance = prt::diffuse_reflectance(scene);
  std::vector<Eigen::Array3f> before;
  for (const Eigen::Vector3f& way : {Eigen::Vector3f(0.2f, 0.9f, -0.4f), Eigen::Vector3f(0.7f, 0.4f, 0.6f)}) {
    const Eigen::Vector3f place = middle + area_light_distance * way.normalized();
    Mesh area_light = prt::sphere_mesh(12);
    for (auto& position : area_light.positions) position = place + 2.0f * area_light_radius * position;
    const Image& outputs = picture(area_light);
    const auto traced =
        prt::test::trace_vertices(scene, 19, area_light_at(place), {.paths = 65536, .bounces = 7});
    prt::test::RelativeError error, of_before;
    for (std::size_t k = 0; k < traced.vertices.size(); ++k) {
      const std::size_t v = traced.vertices[k];
      const Eigen::Map<const Eigen::Array3f> output(&outputs.values[3 * pixel_of_output(v)]);
      error.add(output * reflectance[v], traced.radiance[k]);
      if (!before.empty()) of_before.add(before[k], traced.radiance[k]);
    }
    RecordProperty(before.empty() ? "above" : "aside", std::to_string(error.value()));
    EXPECT_LT(error.value(), 0.04);
    // The lights differ: a picture of the wrong one would not pass.
    EXPECT_TRUE(before.empty() || of_before.value() > 0.3);
    before = traced.radiance;
  }
}

}  // namespace
}  // namespace refield
