// SPDX-License-Identifier: Apache-2.0
#include "core/base/rng.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <set>

namespace refield {
namespace {

struct Moments {
  double mean = 0.0;
  double variance = 0.0;
};

constexpr int draws = 200'000;

Moments moments_of(const std::function<double()>& draw) {
  double sum = 0.0;
  double squares = 0.0;
  for (int i = 0; i < draws; ++i) {
    const double value = draw();
    sum += value;
    squares += value * value;
  }
  const double mean = sum / draws;
  return {mean, squares / draws - mean * mean};
}

/// Five standard errors of the mean: a fixed seed passes or fails for good, a wrong distribution fails.
double tolerance(double standard_deviation) {
  return 5.0 * standard_deviation / std::sqrt(double{draws});
}

TEST(Rng, UniformHasTheMomentsOfTheUnitInterval) {
  Rng rng(7, 1);
  const Moments m = moments_of([&] {
    const double u = rng.uniform();
    EXPECT_TRUE(u >= 0.0 && u < 1.0);
    return u;
  });
  EXPECT_NEAR(m.mean, 0.5, tolerance(std::sqrt(1.0 / 12.0)));
  EXPECT_NEAR(m.variance, 1.0 / 12.0, tolerance(std::sqrt(1.0 / 180.0)));
}

TEST(Rng, NormalHasUnitVariance) {
  Rng rng(7, 2);
  const Moments m = moments_of([&] { return rng.normal(); });
  EXPECT_NEAR(m.mean, 0.0, tolerance(1.0));
  EXPECT_NEAR(m.variance, 1.0, tolerance(std::sqrt(2.0)));
}

class PoissonMoments : public testing::TestWithParam<double> {};

TEST_P(PoissonMoments, MeanAndVarianceAreTheParameter) {
  const double mean = GetParam();
  Rng rng(7, 3);
  const Moments m = moments_of([&] { return rng.poisson(mean); });
  EXPECT_NEAR(m.mean, mean, tolerance(std::sqrt(mean)) + 1e-3 * mean);
  // Fourth central moment of a Poisson: λ + 3λ². Rounding a normal to integers adds 1/12.
  EXPECT_NEAR(m.variance, mean, tolerance(std::sqrt(mean + 2.0 * mean * mean)) + 1e-3 * mean + 1.0 / 12.0);
}
// Both sides of the change of method at 64.
INSTANTIATE_TEST_SUITE_P(Means, PoissonMoments, testing::Values(0.0, 0.3, 5.0, 63.0, 64.0, 1000.0));

TEST(Rng, StreamsOfEqualKeysAreEqualAndOfOthersDiffer) {
  EXPECT_EQ(Rng(1, 2, 3).next(), Rng(1, 2, 3).next());
  std::set<std::uint64_t> first_words;
  for (int a = 0; a < 30; ++a)
    for (int b = 0; b < 30; ++b) first_words.insert(Rng(1, a, b).next());
  EXPECT_EQ(first_words.size(), 900u);
  EXPECT_NE(Rng(1, 2, 3).next(), Rng(1, 3, 2).next());
  EXPECT_NE(Rng(1).next(), Rng(2).next());
}

TEST(Rng, NeighbouringStreamsAreUncorrelated) {
  double product = 0.0;
  for (int i = 0; i < draws; ++i) product += Rng(5, i).normal() * Rng(5, i + 1).normal();
  EXPECT_NEAR(product / draws, 0.0, tolerance(1.0));
}

TEST(Rng, BelowReachesEveryValueEqually) {
  Rng rng(7, 4);
  std::vector<int> counts(6);
  for (int i = 0; i < draws; ++i) ++counts[rng.below(6)];
  for (const int count : counts) EXPECT_NEAR(count, draws / 6.0, 5.0 * std::sqrt(draws / 6.0));
}

}  // namespace
}  // namespace refield
