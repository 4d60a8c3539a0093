// SPDX-License-Identifier: Apache-2.0
#include "estimate/quality/light_order.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

#include "core/base/errors.h"
#include "tests/support/synthetic_capture.h"

namespace refield {
namespace {

std::vector<int> sorted(std::vector<int> order) {
  std::ranges::sort(order);
  return order;
}
std::vector<int> counted(int count) {
  std::vector<int> numbers(count);
  std::iota(numbers.begin(), numbers.end(), 0);
  return numbers;
}

TEST(MostUsefulOrder, NamesEachLightOnce) {
  const auto lights = test::random_lights(20, 16, 12, 3);
  const auto order = max_useful_order(lights);
  EXPECT_EQ(sorted(order), counted(20));
  EXPECT_EQ(max_useful_order(lights), order);
}

TEST(MostUsefulOrder, RepetitionsAndBlackComeLast) {
  auto lights = test::random_lights(8, 16, 12, 5);
  const LightMap black{Image(16, 12, 3), Parameterisation::monitor};
  std::vector<LightMap> candidates = {lights[0], lights[0], black, lights[0]};
  candidates.insert(candidates.end(), lights.begin() + 1, lights.end());
  const auto order = max_useful_order(candidates, 0.01);
  EXPECT_EQ(sorted(order), counted(11));
  // Of three equal lights one is useful, the others are not, and black shows nothing.
  EXPECT_EQ(order.back(), 2);
  std::vector<int> last(order.end() - 3, order.end());
  EXPECT_EQ(std::ranges::count_if(last, [](int i) { return i == 0 || i == 1 || i == 3; }), 2);
}

TEST(MostUsefulOrder, ShowsBothHalvesBeforeTheirVariations) {
  // Light from the left, in three brightnesses, and from the right once.
  std::vector<LightMap> lights;
  for (const float brightness : {0.9f, 0.8f, 1.0f}) {
    LightMap light{Image(16, 12, 3), Parameterisation::monitor};
    for (int y = 0; y < 12; ++y)
      for (int x = 0; x < 8; ++x)
        for (int c = 0; c < 3; ++c) light.radiance.at(x, y, c) = brightness;
    lights.push_back(light);
  }
  LightMap right{Image(16, 12, 3), Parameterisation::monitor};
  for (int y = 0; y < 12; ++y)
    for (int x = 8; x < 16; ++x)
      for (int c = 0; c < 3; ++c) right.radiance.at(x, y, c) = 0.5f;
  lights.push_back(right);
  const auto order = max_useful_order(lights, 0.01);
  EXPECT_LT(std::ranges::find(order, 3) - order.begin(), 2);
}

// A photograph has about the same noise under any light of a capture.
TEST(MostUsefulOrder, BrightLightsComeBeforeDimOnes) {
  auto lights = test::random_lights(12, 16, 12, 9);
  for (std::size_t i = 0; i < 6; ++i)
    for (float& value : lights[2 * i].radiance.values) value *= 0.2f;
  const auto order = max_useful_order(lights);
  for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(order[i] % 2, 1) << i;
}

TEST(MostUsefulOrder, RefusesLightsOfDifferentSizes) {
  std::vector<LightMap> lights = test::random_lights(2, 16, 12, 1);
  lights.push_back(test::random_lights(1, 12, 16, 1).front());
  EXPECT_THROW(max_useful_order(lights), InputError);
}

TEST(RandomOrder, IsAPermutationThatTheSeedDecides) {
  EXPECT_EQ(sorted(random_order(50, 1)), counted(50));
  EXPECT_EQ(random_order(50, 1), random_order(50, 1));
  EXPECT_NE(random_order(50, 1), random_order(50, 2));
  EXPECT_NE(random_order(50, 1), counted(50));
}

}  // namespace
}  // namespace refield
