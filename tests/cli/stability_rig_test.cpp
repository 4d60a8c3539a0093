// SPDX-License-Identifier: Apache-2.0
// What a rig does besides B = T L: a capture of the virtual rig for each effect and for all together,
// estimated with and without the correction.
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "core/base/files.h"
#include "tests/cli/matchers.h"
#include "tests/support/stability.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

namespace fs = std::filesystem;
using test::run_refield;
using test::Succeeded;

const std::string moves_of_creep =
    "[camera]\nmoves = [[0.3, 0.07, 0.04], [0.55, 0.14, 0.09], [0.8, 0.21, 0.13]]\n";
const std::string mixing =
    "mixing_red = [1.0, 0.10, 0.02]\nmixing_green = [0.09, 1.0, 0.08]\nmixing_blue = [0.01, 0.12, 1.0]\n";

/// A rig before the table-top scene.
struct Rig {
  std::string effect, setting;
  std::string recipe;          ///< what is not ideal
  double least_without = 0.0;  ///< error with --rig off, over that of the ideal rig
  double most = INFINITY;      ///< the same with the correction, where it finds the effect
};

void PrintTo(const Rig& rig, std::ostream* stream) {
  *stream << rig.effect;
}

class StabilityOfRigs : public testing::TestWithParam<Rig> {
 protected:
  static void SetUpTestSuite() { folder_ = std::make_unique<test::TemporaryFolder>(); }
  static void TearDownTestSuite() { folder_.reset(); }

  /// The scene as an ideal or a colour-mixing camera sees it; traced once.
  static fs::path truth_of(const std::string& recipe) {
    const bool mixes = recipe.find("mixing") != std::string::npos;
    const fs::path truth = *folder_ / (mixes ? "mixed" : "ideal");
    if (fs::exists(truth)) return truth;
    const fs::path file = recipe_file("truth.toml", mixes ? "[sensor]\n" + mixing : "");
    EXPECT_THAT(run_refield({"simulate", file, "--size", "64x48", "--light-size", "32x24", "--train", "80",
                             "-o", truth}),
                Succeeded());
    return truth;
  }

  static fs::path recipe_file(const std::string& name, const std::string& tables) {
    const std::string base = REFIELD_SOURCE_DIR "/datasets_synthetic/tabletop/recipe.toml";
    write_text_atomically(*folder_ / name, "base = \"" + base + "\"\n" + tables);
    return *folder_ / name;
  }

  static fs::path captured(const std::string& recipe) {
    const fs::path session = *folder_ / "session";
    EXPECT_THAT(run_refield({"acquire", "run", recipe_file("recipe.toml", recipe), "--truth",
                             truth_of(recipe), "--force", "-o", session}),
                Succeeded());
    return session;
  }

  /// Median error of a pixel under held-out natural light, against the exact transport.
  static double error_of(const fs::path& session, const fs::path& truth, const std::string& rig) {
    const fs::path field = *folder_ / "scene.rfield";
    EXPECT_THAT(run_refield({"estimate", session, "--rig", rig, "-o", field}), Succeeded());
    const auto compared =
        run_refield({"--json", "compare", field, session, "--truth", truth / "transport.rfield"});
    EXPECT_THAT(compared, Succeeded());
    return nlohmann::json::parse(compared.out).at("held_out").at("natural").at("median");
  }

  static double ideal_error() {
    static const double error = error_of(captured(""), truth_of(""), "auto");
    return error;
  }

  static std::unique_ptr<test::TemporaryFolder> folder_;
};
std::unique_ptr<test::TemporaryFolder> StabilityOfRigs::folder_;

/// What tells rounding and the choice of kernels from a correction that harms.
constexpr double harmless = 1.05;

TEST_P(StabilityOfRigs, WhatIsFoundIsCorrected) {
  const Rig& rig = GetParam();
  const double ideal = ideal_error();
  const fs::path session = captured(rig.recipe), truth = truth_of(rig.recipe);
  const double corrected = error_of(session, truth, "auto"), uncorrected = error_of(session, truth, "off");
  test::record_figure({"rig: " + rig.effect, rig.setting, corrected, ideal, 0.0, 0.0});
  test::record_figure({"rig: " + rig.effect, rig.setting + ", --rig off", uncorrected, ideal, 0.0, 0.0});
  EXPECT_LE(corrected, harmless * uncorrected);
  EXPECT_LE(corrected, rig.most * ideal);
  EXPECT_GE(uncorrected, rig.least_without * ideal) << "the effect is too small to be a test";
}

INSTANTIATE_TEST_SUITE_P(
    Effects, StabilityOfRigs,
    testing::Values(
        Rig{"colour mixing", "8 to 12 %", "[sensor]\n" + mixing, 1.5, 1.1},
        Rig{"creep", "0.25 pixels", moves_of_creep, 1.5},
        Rig{"bump", "0.5 pixels at a third", "[camera]\nmoves = [[0.33, 0.4, -0.3]]\n", 1.5},
        Rig{"walk", "0.2 pixels around",
            "[camera]\nmoves = [[0.2, 0.2, 0.0], [0.4, 0.1, 0.2], [0.6, -0.1, 0.1], [0.8, -0.2, -0.1]]\n"},
        Rig{"gain", "1 % per photograph", "[sensor]\ngain_jitter = 0.01\n"},
        Rig{"white balance", "1 % per channel", "[sensor]\nbalance_jitter = 0.01\n"},
        Rig{"tone curve", "exponent off by 3 %", "[monitor]\nstated_gamma = [2.27, 2.31, 2.20]\n"},
        Rig{"room light", "twice as bright from a half on", "[ambient]\nswitched = [[0.5, 2.0]]\n", 4.5, 4.0},
        Rig{"shutter times", "rounded", "[sensor]\nrounds_exposures = true\n"},
        Rig{"all of these", "as in ./dev demo",
            moves_of_creep +
                "[monitor]\nstated_gamma = [2.27, 2.31, 2.20]\n[ambient]\nvariation = 0.05\n[sensor]\n" +
                mixing + "gain_jitter = 0.01\nbalance_jitter = 0.003\nrounds_exposures = true\n"}),
    [](const auto& tested) {
      std::string name = tested.param.effect;
      std::erase(name, ' ');
      return name;
    });

// The predictor does not know what designed patterns show in detail, which looked like gains of 5 %.
TEST(PerfectRig, DesignedPatternsShowNoEffect) {
  const test::TemporaryFolder folder;
  ASSERT_THAT(
      run_refield({"simulate", REFIELD_SOURCE_DIR "/datasets_synthetic/tabletop/recipe.toml", "--size",
                   "48x36", "--train", "120", "--kind", "designed", "-o", folder / "session"}),
      Succeeded());
  const auto checked = run_refield({"--json", "info", folder / "session"});
  ASSERT_THAT(checked, Succeeded());
  for (const auto& row : nlohmann::json::parse(checked.out).at("check").at("properties"))
    EXPECT_EQ(row.at("state"), "good") << row;
}

}  // namespace
}  // namespace refield
