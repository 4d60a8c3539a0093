// SPDX-License-Identifier: Apache-2.0
#include "core/light/summed_area_table.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "core/base/errors.h"
#include "core/field/light_basis.h"
#include "tests/support/random_data.h"

namespace refield {
namespace {

std::array<double, 3> brute_force_sum(const Image& image, const Box& box) {
  std::array<double, 3> sum = {0.0, 0.0, 0.0};
  for (int y = box.y0; y < box.y1; ++y)
    for (int x = box.x0; x < box.x1; ++x)
      for (int c = 0; c < 3; ++c) sum[c] += image.at(x, y, c);
  return sum;
}

double worst_relative_error(const Image& image, const std::vector<Box>& boxes) {
  const SummedAreaTable table(image);
  double worst = 0.0;
  for (const Box& box : boxes) {
    const auto expected = brute_force_sum(image, box);
    const auto found = table.sum(box);
    for (int c = 0; c < 3; ++c)
      worst = std::max(worst, std::abs(found[c] - expected[c]) / std::max(expected[c], 1e-300));
  }
  return worst;
}

TEST(SummedAreaTable, EqualsDirectSumsOnEveryBoxOfASmallMap) {
  Rng rng(1);
  const Image image = test::random_image(rng, 7, 5, 3);
  std::vector<Box> boxes;
  for (int y0 = 0; y0 < 5; ++y0)
    for (int y1 = y0 + 1; y1 <= 5; ++y1)
      for (int x0 = 0; x0 < 7; ++x0)
        for (int x1 = x0 + 1; x1 <= 7; ++x1) boxes.push_back({x0, y0, x1, y1});
  constexpr double rounding = 1e-12;  // a few double roundings of sums near 35, over texels above 1e-3
  EXPECT_LT(worst_relative_error(image, boxes), rounding);
}

// The map must also hold where it is hardest: one-texel boxes in the dark, beyond a sun in the prefix sums.
TEST(SummedAreaTable, KeepsSingleDarkTexelsBesideASunInAWideMap) {
  Rng rng(2);
  Image image = test::random_image(rng, 2048, 1024, 3, 0.01, 1.0);
  for (int c = 0; c < 3; ++c)
    for (int y = 100; y < 104; ++y)
      for (int x = 300; x < 304; ++x) image.at(x, y, c) = 1e5f;
  std::vector<Box> boxes;
  for (int i = 0; i < 300; ++i) {
    const auto x = static_cast<std::int32_t>(rng.below(2048));
    const auto y = static_cast<std::int32_t>(rng.below(1024));
    boxes.push_back({x, y, x + 1, y + 1});
  }
  for (int i = 0; i < 20; ++i) boxes.push_back(test::random_box(rng, 2048, 1024));
  constexpr double promised = 1e-6;
  EXPECT_LT(worst_relative_error(image, boxes), promised);
}

TEST(SummedAreaTable, RefusesGreyImages) {
  EXPECT_THROW(SummedAreaTable(Image(4, 4, 1)), InputError);
}

TEST(LightBasis, ProjectsToTheSumsOfItsBoxes) {
  Rng rng(3);
  const LightDomain domain{31, 17, Parameterisation::monitor};
  const LightMap light = test::random_light(rng, domain);
  LightBasis basis{domain, {}, {}};
  for (int k = 0; k < 200; ++k) basis.boxes.push_back(test::random_box(rng, domain.width, domain.height));
  const auto coefficients = basis.project(light);
  ASSERT_EQ(coefficients.size(), basis.boxes.size() * 3);
  for (std::size_t k = 0; k < basis.boxes.size(); ++k) {
    const auto expected = brute_force_sum(light.radiance, basis.boxes[k]);
    for (int c = 0; c < 3; ++c) EXPECT_FLOAT_EQ(coefficients[3 * k + c], static_cast<float>(expected[c]));
  }
}

TEST(LightBasis, SaysWhichLightMapItExpects) {
  const LightBasis basis{{8, 4, Parameterisation::monitor}, {}, {{0, 0, 8, 4}}};
  const LightMap wrong_size{Image(9, 4, 3), Parameterisation::monitor};
  const LightMap wrong_kind{Image(8, 4, 3), Parameterisation::lat_long};
  try {
    basis.project(wrong_size);
    FAIL() << "a map of the wrong size was taken";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("8×4"), std::string::npos) << error.what();
  }
  EXPECT_THROW(basis.project(wrong_kind), InputError);
}

}  // namespace
}  // namespace refield
