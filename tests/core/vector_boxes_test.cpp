// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "core/base/rng.h"
#include "core/field/light_basis.h"
#include "core/light/cube_map.h"
#include "tests/support/random_data.h"

namespace refield {
namespace {

constexpr int side = 13;  // no power of two

/// Boxes anywhere on a face, up to three kernels each.
LightBasis random_basis(Rng& rng) {
  LightBasis basis{cube_domain(side), {}, {}, Measure::solid_angle};
  for (int i = 0; i < 40; ++i) {
    Box box = test::random_box(rng, side, side);
    const auto face = static_cast<int>(rng.below(cube_faces));
    box.y0 += face * side;
    box.y1 += face * side;
    for (std::uint64_t kernels = 1 + rng.below(3); kernels > 0; --kernels)
      basis.vector_boxes.push_back(
          {box,
           {static_cast<float>(rng.uniform(-1.0, 1.0)), static_cast<float>(rng.uniform(-1.0, 1.0)),
            static_cast<float>(rng.uniform(-1.0, 1.0))}});
  }
  return basis;
}

/// Texel by texel, by the values of kernels.
double sum_of_values(const LightBasis& basis, std::size_t kernel, const LightMap& light, int channel) {
  double sum = 0.0;
  for (int y = 0; y < basis.domain.height; ++y)
    for (int x = 0; x < basis.domain.width; ++x)
      sum += static_cast<double>(basis.value(kernel, x, y)) * cube_solid_angle(x, y, side) *
             light.radiance.at(x, y, channel);
  return sum;
}

TEST(VectorBoxes, SumLightByTheirValues) {
  constexpr double rounding = 1e-6;
  Rng rng(1);
  const LightBasis basis = random_basis(rng);
  LightMap light = test::random_light(rng, basis.domain);
  const std::vector<float> whole = basis.project(light);
  ASSERT_EQ(whole.size(), 3 * basis.size());
  for (std::size_t k = 0; k < basis.size(); ++k)
    for (int c = 0; c < 3; ++c)
      EXPECT_NEAR(whole[3 * k + static_cast<std::size_t>(c)], sum_of_values(basis, k, light, c), rounding);

  // Of light that is zero outside a rectangle, which may reach over several faces, that rectangle is enough.
  const SmoothProjector projector(basis);
  for (int i = 0; i < 50; ++i) {
    const Box within = test::random_box(rng, side, cube_faces * side);
    LightMap inside{Image(side, cube_faces * side, 3), Parameterisation::cube};
    Image part(within.width(), within.height(), 3);
    for (int y = within.y0; y < within.y1; ++y)
      for (int x = within.x0; x < within.x1; ++x)
        for (int c = 0; c < 3; ++c)
          part.at(x - within.x0, y - within.y0, c) = inside.radiance.at(x, y, c) = light.radiance.at(x, y, c);
    const std::vector<float> expected = basis.project(inside);
    projector.weigh(part, within);
    const std::vector<double> sums = projector.project(part, within);
    for (std::size_t j = 0; j < expected.size(); ++j) ASSERT_NEAR(sums[j], expected[j], rounding);
  }
}

// ∫ cos dω over a face of the cube, as the form factor of a square opposite (Siegel and Howell).
TEST(VectorBoxes, OfAFaceHaveItsFormFactor) {
  const double exact = 2.0 * std::numbers::sqrt2 * std::atan(1.0 / std::numbers::sqrt2);
  for (int face = 0; face < cube_faces; ++face) {
    const Eigen::Vector3d ahead = cube_face_axes(face).row(2);
    LightBasis basis{cube_domain(64), {}, {}, Measure::solid_angle};
    basis.vector_boxes = {{{0, 64 * face, 64, 64 * (face + 1)}, ahead.cast<float>()}};
    const LightMap white{Image(64, 64 * cube_faces, 3, 1.0f), Parameterisation::cube};
    EXPECT_NEAR(basis.project(white)[0], exact, 1e-6);
    EXPECT_NEAR(basis.area(0), exact, 0.1 * exact);  // an estimate
  }
}

}  // namespace
}  // namespace refield
