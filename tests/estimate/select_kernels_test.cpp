// SPDX-License-Identifier: Apache-2.0
#include "estimate/select_kernels.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "core/rng.h"

namespace refield {
namespace {

/// `size` random positive columns in `rank` coordinates; the samples are columns 3 and 7, plus noise.
KernelDictionary dictionary_of_two(int size, int rank, double noise, double outside) {
  KernelDictionary dictionary;
  dictionary.resize(size, rank);
  Rng rng(1);
  dictionary.squared_outside = outside;
  dictionary.squared_samples = outside;
  dictionary.measured = 300;
  for (int c = 0; c < 3; ++c) {
    for (int d = 0; d < size; ++d)
      for (int k = 0; k < rank; ++k) dictionary.column(c, d)[k] = static_cast<float>(rng.uniform());
    for (int k = 0; k < rank; ++k) {
      const double b =
          2.0 * dictionary.column(c, 3)[k] + 0.5 * dictionary.column(c, 7)[k] + noise * rng.normal();
      dictionary.samples[c][k] = b;
      dictionary.squared_samples += b * b;
    }
  }
  return dictionary;
}

TEST(KernelSelector, FindsTheTwoThatMadeTheSamples) {
  KernelSelector selector;
  selector.select(dictionary_of_two(40, 30, 0.0, 0.0), 25);
  std::vector<int> chosen;
  for (std::size_t i = 0; i < selector.chosen().size(); ++i)
    if (selector.weights(0)[i] > 1e-3) chosen.push_back(selector.chosen()[i]);
  std::ranges::sort(chosen);
  EXPECT_EQ(chosen, (std::vector<int>{3, 7}));
  for (std::size_t i = 0; i < selector.chosen().size(); ++i) {
    const double expected = selector.chosen()[i] == 3 ? 2.0 : selector.chosen()[i] == 7 ? 0.5 : 0.0;
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(selector.weights(c)[i], expected, 1e-3);
  }
}

TEST(KernelSelector, NoiseDoesNotBuyKernels) {
  KernelSelector selector;
  const auto count_at = [&](double noise) {
    // What lies outside the space is noise of the same size in the remaining images.
    selector.select(dictionary_of_two(60, 50, noise, 150 * noise * noise), 25);
    return selector.chosen().size();
  };
  EXPECT_LE(count_at(0.3), 4u);
  EXPECT_GE(count_at(0.3), 1u);
}

TEST(KernelSelector, RespectsTheCap) {
  KernelDictionary dictionary = dictionary_of_two(40, 30, 0.0, 0.0);
  Rng rng(9);
  for (int c = 0; c < 3; ++c)
    for (int k = 0; k < 30; ++k) dictionary.samples[c][k] = 5.0 * rng.uniform();
  KernelSelector selector;
  for (const int most : {1, 2, 5, 12}) {
    selector.select(dictionary, most);
    std::size_t kept = 0;
    for (std::size_t i = 0; i < selector.chosen().size(); ++i)
      kept += selector.weights(0)[i] > 0.0 || selector.weights(1)[i] > 0.0 || selector.weights(2)[i] > 0.0;
    EXPECT_LE(kept, static_cast<std::size_t>(most));
    EXPECT_GE(kept, 1u);
  }
}

TEST(KernelSelector, NothingToExplainNeedsNoKernel) {
  KernelDictionary dictionary = dictionary_of_two(10, 8, 0.0, 0.0);
  dictionary.squared_samples = 0.0;
  for (auto& samples : dictionary.samples) std::ranges::fill(samples, 0.0);
  KernelSelector selector;
  selector.select(dictionary, 5);
  EXPECT_TRUE(selector.chosen().empty());
  // Samples that point away from all columns: no non-negative weight helps.
  for (auto& samples : dictionary.samples) std::ranges::fill(samples, -1.0);
  dictionary.squared_samples = 24.0;
  selector.select(dictionary, 5);
  EXPECT_TRUE(selector.chosen().empty());
  EXPECT_EQ(selector.squared_residual(), 24.0);
}

TEST(InformationCriterion, RewardsFitAndCountsParameters) {
  EXPECT_LT(information_criterion(1.0, 10.0, 100, 5), information_criterion(2.0, 10.0, 100, 5));
  EXPECT_LT(information_criterion(1.0, 10.0, 100, 5), information_criterion(1.0, 10.0, 100, 6));
  EXPECT_TRUE(std::isfinite(information_criterion(0.0, 10.0, 100, 5)));
  EXPECT_TRUE(std::isfinite(information_criterion(0.0, 0.0, 100, 0)));
}

}  // namespace
}  // namespace refield
