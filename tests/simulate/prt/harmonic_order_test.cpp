// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "simulate/prt/mesh_rays.h"
#include "tests/simulate/prt/path_comparison.h"
#include "tests/simulate/prt/small_scenes.h"

namespace refield::prt {
namespace {

HarmonicTransfer transfer_of(const Scene& scene, const HarmonicOptions& options) {
  HarmonicStatistics statistics;
  return harmonic_transfer(scene, options, statistics);
}

const Eigen::Vector3f from_above = Eigen::Vector3f(0.5f, 1.0f, -0.3f).normalized();

/// Chosen by need: light that is a lobe of some 60 degrees needs order 4 or 5 (docs/harmonics.md has the
/// table).
TEST(HarmonicOrder, MoreIsBetterForSmoothLight) {
  const Scene scene = test::ball_scene({});
  const auto lobe = [](const Eigen::Vector3f& from) -> Eigen::Array3f {
    return Eigen::Array3f::Constant(std::exp(4.0f * (from.dot(from_above) - 1.0f)));
  };
  const auto traced = test::trace_vertices(
      scene, 31, [&](const Eigen::Vector3f&, const Eigen::Vector3f& from) { return lobe(from); },
      {.paths = 16384});
  double before = 1.0;
  for (const int order : {2, 3, 5}) {
    const HarmonicTransfer transfer = transfer_of(scene, {.order = order, .directions = 1024});
    const double error = test::error_of(transfer, scene, test::project(lobe, order), traced);
    EXPECT_LT(error, 0.5 * before);
    before = error;
  }
  EXPECT_LT(before, 0.015);
}

/// A light of a degree's size, direct light alone.
struct Sun {
  Scene scene = test::ball_scene({});
  MeshRays rays{scene.mesh};
  static constexpr double half_angle = 0.01;

  bool shines_on(std::size_t vertex) const {
    const Eigen::Vector3f from = rays.off_surface(scene.mesh.positions[vertex], scene.mesh.normals[vertex]);
    return rays.unoccluded(std::span(&from, 1), from_above) & 1;
  }
  float unshadowed(std::size_t vertex) const {
    return static_cast<float>(half_angle * half_angle) *
           std::max(0.0f, scene.mesh.normals[vertex].dot(from_above));
  }
  struct Seen {
    double error, darkest, shadows;  // darkest: over the brightest; shadows: light in them over what none had
  };
  Seen seen(int order, HarmonicWindow window) const {
    const HarmonicTransfer transfer =
        transfer_of(scene, {.order = order, .directions = 1024, .until = 1.0, .window = window});
    const test::HarmonicLight light = test::cap_light(from_above, half_angle, order);
    test::RelativeError error;
    float low = 0.0f, high = 0.0f, in_shadow = 0.0f, without = 0.0f;
    for (std::size_t v = 0; v < scene.mesh.positions.size(); ++v) {
      const float value = (test::radiance(transfer, scene, light, v, {}) / transfer.colours[v])[0];
      const float expected = shines_on(v) ? unshadowed(v) : 0.0f;
      error.add(Eigen::Array3f::Constant(value), Eigen::Array3f::Constant(expected));
      low = std::min(low, value);
      high = std::max(high, value);
      if (expected < unshadowed(v)) {
        in_shadow += value;
        without += unshadowed(v);
      }
    }
    return {error.value(), low / high, in_shadow / without};
  }
};

/// What harmonics cannot do: at order 8 the hard shadows of a small light are still lit in part, and the
/// error is ten times that of smooth light.
TEST(HarmonicOrder, HardShadowsAreBeyondAll) {
  const Sun::Seen seen = Sun().seen(8, HarmonicWindow::none);
  EXPECT_GT(seen.error, 0.08);
  EXPECT_GT(seen.shadows, 0.05);
}

TEST(HarmonicOrder, RingingIsDampedByWindows) {
  const Sun sun;
  const Sun::Seen plain = sun.seen(5, HarmonicWindow::none), lanczos = sun.seen(5, HarmonicWindow::lanczos),
                  hann = sun.seen(5, HarmonicWindow::hann);
  EXPECT_LT(plain.darkest, -0.05);
  EXPECT_GT(lanczos.darkest, 0.4 * plain.darkest);
  EXPECT_GT(hann.darkest, 0.4 * plain.darkest);
  // It is paid for by shadows and highlights that are softer still.
  EXPECT_GT(hann.error, lanczos.error);
  EXPECT_GT(lanczos.error, plain.error);
}

}  // namespace
}  // namespace refield::prt
