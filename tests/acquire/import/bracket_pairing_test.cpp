// SPDX-License-Identifier: Apache-2.0
#include "acquire/import/bracket_pairing.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "core/base/rng.h"

namespace refield {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::Pair;

constexpr std::size_t patterns = 60;
constexpr double every = 6.0;  // seconds per pattern

/// Smooth light of random colour: places of different size and brightness.
BlockMeans random_light(Rng& rng) {
  Image image(24, 16, 3);
  for (int blob = 0; blob < 4; ++blob) {
    const double x = rng.uniform(0.0, 24.0), y = rng.uniform(0.0, 16.0), size = rng.uniform(2.0, 8.0);
    const double colour[3] = {rng.uniform(), rng.uniform(), rng.uniform()};
    for (int v = 0; v < 16; ++v)
      for (int u = 0; u < 24; ++u)
        for (int c = 0; c < 3; ++c)
          image.at(u, v, c) += static_cast<float>(
              colour[c] * std::exp(-(std::pow(u + 0.5 - x, 2) + std::pow(v + 0.5 - y, 2)) / (size * size)));
  }
  return block_means(image);
}

/// A scene that each block of a photograph shows another part of.
class Scene {
 public:
  Scene() : rng_(3, 1u), black_(BlockMeans::Constant(random_light(rng_).size(), 0.002f)) {
    const Eigen::Index size = black_.size();
    transport_ = Eigen::MatrixXf::Zero(size, size);
    for (Eigen::Index k = 0; k < size; ++k)
      for (Eigen::Index g = k % 3; g < size; g += 3)
        transport_(k, g) = static_cast<float>(std::pow(rng_.uniform(), 3)) / static_cast<float>(size);
    for (std::size_t j = 0; j < patterns; ++j) {
      series_.lights.push_back(random_light(rng_));
      series_.shown.push_back(every * static_cast<double>(j));
    }
  }
  void photograph(std::size_t light, std::optional<ClockSeconds> time = {}) {
    add(transport_ * series_.lights[light] + black_, time);
  }
  void black() { add(black_, {}); }
  OrderedSeries& series() { return series_; }

 private:
  void add(BlockMeans means, std::optional<ClockSeconds> time) {
    for (float& value : means) value *= static_cast<float>(1.0 + 0.002 * rng_.normal());
    series_.photographs.push_back(means);
    series_.taken.push_back(time);
  }
  Rng rng_;
  BlockMeans black_;
  Eigen::MatrixXf transport_;
  OrderedSeries series_;
};

TEST(BracketPairing, BracketsInOrderStayAsTheyAre) {
  Scene scene;
  scene.black();
  for (std::size_t j = 0; j < patterns; ++j) scene.photograph(j);
  scene.series().first_is_black = true;
  const OrderedPairing pairing = pair_in_order(scene.series());
  EXPECT_TRUE(pairing.is_certain);
  EXPECT_THAT(pairing.black, ElementsAre(0U));
  EXPECT_THAT(pairing.doubled, IsEmpty());
  for (std::size_t j = 0; j < patterns; ++j) EXPECT_EQ(pairing.bracket_of[j], j + 1);
}

TEST(BracketPairing, FindsBlackMissingAndRepeatedBrackets) {
  Scene scene;
  std::vector<std::optional<std::size_t>> expected(patterns);
  std::size_t place = 0;
  const auto count = [&] { return place++; };
  for (int i = 0; i < 3; ++i) scene.black(), count();
  for (std::size_t j = 0; j < patterns; ++j) {
    if (j == 20) continue;
    if (j == 30) scene.black(), count();  // shown again after a stop
    scene.photograph(j);
    expected[j] = count();
    if (j == 40) scene.photograph(j), count();
  }
  scene.black();
  const OrderedPairing pairing = pair_in_order(scene.series());
  EXPECT_TRUE(pairing.is_certain);
  EXPECT_EQ(pairing.bracket_of, expected);
  EXPECT_THAT(pairing.black, ElementsAre(0U, 1U, 2U, 32U, 64U));
  EXPECT_THAT(pairing.doubled, ElementsAre(Pair(44U, 40U)));
  EXPECT_THAT(pairing.stray, IsEmpty());
}

TEST(BracketPairing, EqualCountsDoNotHideMissingAndRepeatedBrackets) {
  Scene scene;
  for (std::size_t j = 0; j < patterns; ++j) {
    if (j != 10) scene.photograph(j);
    if (j == 45) scene.photograph(j);
  }
  const OrderedPairing pairing = pair_in_order(scene.series());
  EXPECT_FALSE(pairing.bracket_of[10]);
  EXPECT_EQ(pairing.bracket_of[30], 29U);
  EXPECT_EQ(pairing.bracket_of[50], 50U);
}

TEST(BracketPairing, AnOddPhotographKeepsItsPlace) {
  Scene scene;
  for (std::size_t j = 0; j < patterns; ++j) scene.photograph(j);
  scene.series().photographs[25] *= 5.0f;  // the room light
  const OrderedPairing pairing = pair_in_order(scene.series());
  for (std::size_t j = 0; j < patterns; ++j) EXPECT_EQ(pairing.bracket_of[j], j);
}

TEST(BracketPairing, TimesTellWhichOfEqualPatternsIsMissing) {
  Scene scene;
  scene.series().lights[21] = scene.series().lights[20];
  for (std::size_t j = 0; j < patterns; ++j)
    if (j != 20) scene.photograph(j, 1e6 + every * static_cast<double>(j) + static_cast<double>(j % 3));
  const OrderedPairing pairing = pair_in_order(scene.series());
  EXPECT_FALSE(pairing.bracket_of[20]);
  EXPECT_EQ(pairing.bracket_of[21], 20U);
}

/// Where the method fails: patterns of one brightness and form tell nothing.
TEST(BracketPairing, IsUncertainWhereLightsDoNotDiffer) {
  Scene scene;
  for (std::size_t j = 1; j < patterns; ++j) scene.series().lights[j] = scene.series().lights[0];
  for (std::size_t j = 0; j + 1 < patterns; ++j) scene.photograph(j);
  EXPECT_FALSE(pair_in_order(scene.series()).is_certain);
}

}  // namespace
}  // namespace refield
