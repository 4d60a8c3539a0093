// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/transfer_samples.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include "tests/simulate/prt/small_scenes.h"

namespace refield::prt {
namespace {

constexpr double pi = std::numbers::pi;

/// Mean and largest deviation from one of what all outputs give under white light, by a sum over a cube.
std::pair<double, double> under_white_light(const Scene& scene, const TransferOptions& options,
                                            int resolution) {
  const OutputLayout layout = layout_of(scene, options.relighting);
  const TransferSamples transfer(scene, options, layout.outputs);
  std::vector<float> values(transfer.group_values());
  std::vector<double> sums(layout.outputs.size());
  for (std::size_t g = 0; g < transfer.groups(); ++g)
    for (int y = 0; y < cube_faces * resolution; ++y)
      for (int x = 0; x < resolution; ++x) {
        transfer.evaluate(g, cube_direction(x + 0.5, y + 0.5, resolution).cast<float>(), values);
        for (std::size_t i = 0; i < TransferSamples::group_outputs; ++i)
          sums[g * TransferSamples::group_outputs + i] += values[i] * cube_solid_angle(x, y, resolution);
      }
  double mean = 0.0, largest = 0.0;
  const auto vertices = static_cast<double>(scene.mesh.positions.size());
  for (std::size_t i = 0; i < sums.size(); ++i) {
    if (layout.outputs[i] == OutputLayout::none) continue;
    mean += sums[i] / vertices;
    largest = std::max(largest, std::abs(sums[i] - 1.0));
  }
  return {mean, largest};
}

TEST(TransferSamples, OfWhiteSurfacesAddUpToOneUnderWhiteLightOnceLightHasBouncedEnough) {
  Scene scene = test::rabbit_scene();
  for (Material& material : scene.materials) material.diffuse.setOnes();
  const auto [direct, unused] = under_white_light(scene, {}, 16);
  EXPECT_LT(direct, 0.9) << "the rabbit and the plane hardly hide the light from each other";
  const auto [mean, largest] = under_white_light(scene, {.bounces = 12}, 16);
  EXPECT_NEAR(mean, 1.0, 0.01);
  EXPECT_LT(largest, 0.15);  // 128 rays around a vertex; light on a mesh of few vertices
}

/// A wall along z, facing −x, beside ground.
Scene wall_beside_ground() {
  Scene scene;
  test::add(scene, plane_mesh(16), test::stretched(2.0f), {.diffuse = {1.0f, 1.0f, 1.0f}});
  for (auto& position : scene.mesh.positions) position = {1.0f, position.x() + 1.0f, 30.0f * position.z()};
  for (auto& normal : scene.mesh.normals) normal = {-1.0f, 0.0f, 0.0f};
  const Eigen::Vector3f a = scene.mesh.positions[scene.mesh.triangles[0][0]];
  const Eigen::Vector3f b = scene.mesh.positions[scene.mesh.triangles[0][1]];
  const Eigen::Vector3f c = scene.mesh.positions[scene.mesh.triangles[0][2]];
  if ((b - a).cross(c - a).x() > 0.0f)
    for (auto& triangle : scene.mesh.triangles) std::swap(triangle[1], triangle[2]);
  scene.materials[0].diffuse = {0.8f, 0.4f, 0.0f};
  test::add(scene, plane_mesh(1), test::stretched(1.0f), {});
  return scene;
}

TEST(TransferSamples, OfGroundBesideALitWallAreWhatItsFormFactorSays) {
  const Scene scene = wall_beside_ground();
  const auto ground = static_cast<std::uint32_t>(scene.mesh.positions.size() - 4);
  const std::vector<std::uint32_t> outputs = {ground, ground + 1, ground + 2, ground + 3};
  const TransferSamples transfer(scene, {.bounces = 1}, outputs);
  ASSERT_EQ(transfer.channels(), 3);
  // From the left and a little from below the ground, which gets no light of its own.
  const Eigen::Vector3f light = Eigen::Vector3f(1.0f, -0.05f, 0.0f).normalized() * -1.0f;
  const Eigen::Vector3f from_below = {light.x(), -light.y(), 0.0f};
  std::vector<float> values(transfer.group_values());
  EXPECT_EQ(transfer.evaluate(0, from_below, values), 0u) << "ground that faces away was traced";
  for (std::size_t i = 0; i < outputs.size(); ++i) {
    const double away = 1.0 - scene.mesh.positions[outputs[i]].x(), height = 2.0;
    const double form_factor = 0.5 * (1.0 - away / std::hypot(away, height));
    constexpr double of_rays = 0.05, of_cells = 0.05;
    EXPECT_NEAR(values[i], 0.8 * form_factor / pi, (of_rays + of_cells) * 0.8 * form_factor / pi);
    EXPECT_NEAR(values[16 + i], 0.5 * values[i], 1e-3);
    EXPECT_EQ(values[32 + i], 0.0f);
  }
}

TEST(TransferSamples, OfAPixelFollowThePhongFormula) {
  Scene scene;
  const Material material{.diffuse = {0.3f, 0.2f, 0.1f}, .specular = {0.5f, 0.6f, 0.7f}, .exponent = 40.0f};
  test::add(scene, plane_mesh(1), test::stretched(100.0f), material);
  const Eigen::Vector3f eye = {0.0f, 2.0f, -2.0f};
  scene.camera = PinholeCamera{.position = eye, .width = 1, .height = 1};
  const OutputLayout layout = layout_of(scene, Relighting::image);
  const Eigen::Vector3d normal = {0, 1, 0}, sight = eye.cast<double>().normalized();
  for (const int pixel_samples : {1, 3}) {
    const TransferSamples transfer(scene, {.relighting = Relighting::image, .pixel_samples = pixel_samples},
                                   layout.outputs);
    std::vector<float> values(transfer.group_values());
    // Where a pixel is a mean over 35 degrees, the lobe is smeared; compare light far from it.
    for (const Eigen::Vector3d& light :
         {Eigen::Vector3d(0, 1, 1), Eigen::Vector3d(0.1, 1, 0.9), Eigen::Vector3d(1, 1, -1)}) {
      const Eigen::Vector3d direction = light.normalized();
      const Eigen::Vector3d mirrored = 2.0 * normal.dot(direction) * normal - direction;
      const double lobe = std::pow(std::max(mirrored.dot(sight), 0.0), 40.0);
      if (pixel_samples > 1 && lobe > 1e-6) continue;
      transfer.evaluate(0, direction.cast<float>(), values);
      for (int c = 0; c < 3; ++c) {
        const double f = material.diffuse[c] / pi + material.specular[c] * 42.0 / (2.0 * pi) * lobe;
        EXPECT_NEAR(values[16 * c], f * normal.dot(direction), 1e-5 + 1e-4 * f);
      }
    }
    transfer.evaluate(0, {0.0f, -1.0f, 0.0f}, values);
    EXPECT_EQ(values[0], 0.0f);
  }
}

}  // namespace
}  // namespace refield::prt
