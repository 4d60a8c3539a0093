// SPDX-License-Identifier: Apache-2.0
#include "relight/pack/pack.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/base/errors.h"
#include "core/image/metrics.h"
#include "tests/relight/mixed_field.h"
#include "tests/support/random_data.h"
#include "tests/support/series_error.h"

namespace refield {
namespace {

constexpr LightDomain monitor{50, 40, Parameterisation::monitor};

TEST(Pack, KeepsTheErrorAskedFor) {
  // Three bands of tiles, the last of them cut off.
  const ReflectanceField field = test::mixed_field(30, 141, monitor);
  const std::vector<ProbeLights> probes = probe_lights(monitor);
  std::size_t pruned = field.transfer.entries();
  for (const double asked : {1e-1, 1e-2, 3e-3, 3e-4, 1e-5}) {
    PackResult result = pack_field(field, asked);
    EXPECT_LE(result.cost.pruned, pruned) << asked;
    pruned = result.cost.pruned;
    ASSERT_EQ(result.cost.errors.size(), probes.size());
    const ReflectanceField packed = expand(std::move(result.field));
    for (std::size_t kind = 0; kind < probes.size(); ++kind) {
      std::vector<Image> expected, shown;
      for (const LightMap& light : probes[kind].lights) {
        expected.push_back(field.relight(light));
        shown.push_back(packed.relight(light));
      }
      const double error = relative_rmse(shown, expected);
      EXPECT_LE(error, asked) << probes[kind].kind;
      // Summed in another order.
      EXPECT_NEAR(error, result.cost.errors[kind].relative_rmse, 1e-9 * error);
    }
    // Lights that it was not chosen by.
    Rng rng(9);
    const LightMap other = test::random_light(rng, monitor);
    EXPECT_LE(relative_rmse(packed.relight(other), field.relight(other)), asked);
  }
}

TEST(Pack, KeepsWhereLightWasObserved) {
  ReflectanceField field = test::mixed_field(20, 10, monitor);
  field.observed_light = {{0, 0, 25, 40}};
  EXPECT_EQ(pack_field(field, 1e-2).field.outline.observed_light, field.observed_light);
}

TEST(Pack, KeepsTheErrorAskedForWithWeightsOfBothSigns) {
  const ReflectanceField field = test::with_both_signs(test::mixed_field(40, 21, monitor));
  Rng rng(9);
  const LightMap light = test::random_light(rng, monitor);
  for (const double asked : {3e-2, 1e-4}) {
    PackResult result = pack_field(field, asked);
    if (asked > 1e-2) {
      EXPECT_GT(result.cost.pruned, 0u);
    }
    EXPECT_LE(result.cost.worst_error(), asked);
    EXPECT_EQ(fault_of_tiles(result.field), "");
    EXPECT_LE(relative_rmse(expand(std::move(result.field)).relight(light), field.relight(light)), asked);
  }
}

TEST(Pack, PrunesMoreTheMoreErrorIsAllowed) {
  const ReflectanceField field = test::mixed_field(60, 41, monitor);
  EXPECT_GT(pack_field(field, 1e-1).cost.pruned, pack_field(field, 1e-2).cost.pruned);
  EXPECT_EQ(pack_field(field, 1e-2).cost.bits, 8);
  EXPECT_EQ(pack_field(field, 1e-4).cost.bits, 16);
}

TEST(Pack, SaysWhatCannotBeHad) {
  const ReflectanceField field = test::mixed_field(20, 20, monitor);
  EXPECT_THROW(pack_field(field, 0.0), InputError);
  try {
    pack_field(field, 1e-8);
    FAIL() << "packed without error";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("16 bits"), std::string::npos) << error.what();
  }
}

TEST(Pruning, PredictsTheErrorsOfItsLevels) {
  const ReflectanceField field = test::mixed_field(60, 41, monitor);
  const std::vector<ProbeLights> probes = probe_lights(monitor);
  const Pruning pruning(field, probes);
  for (const int level : {0, 70, 85, Pruning::levels - 1}) {
    const ReflectanceField pruned{field, pruning.prune(level, {0, field.height})};
    for (std::size_t kind = 0; kind < probes.size(); ++kind) {
      std::vector<Image> expected, shown;
      for (const LightMap& light : probes[kind].lights) {
        expected.push_back(field.relight(light));
        shown.push_back(pruned.relight(light));
      }
      EXPECT_NEAR(relative_rmse(shown, expected), std::sqrt(pruning.squared_errors(level)[kind]), 2e-5)
          << probes[kind].kind << ", level " << level;
    }
    // White light is kept whole.
    EXPECT_LT(std::sqrt(pruning.squared_errors(level)[0]), 2e-5) << level;
  }
  EXPECT_EQ(pruning.prune(0, {0, field.height}).column, field.transfer.column);
  EXPECT_GT(pruning.squared_errors(Pruning::levels - 1)[2], 1e-4);
}

}  // namespace
}  // namespace refield
