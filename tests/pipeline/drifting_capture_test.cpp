// SPDX-License-Identifier: Apache-2.0
// acquire with a monitor that drifts: reference frames tell by how much, and a capture that was killed and
// goes on takes the same photographs.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "core/base/files.h"
#include "core/field/drift.h"
#include "tests/pipeline/program.h"
#include "tests/pipeline/tiny_recipe.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

using namespace test;

TEST(AcquireProgram, ReferenceFramesTellTheDriftAndSurviveAKill) {
  const test::TemporaryFolder folder;
  std::string recipe = tiny_recipe;
  const std::string monitor = "[monitor]\n";
  recipe.insert(recipe.find(monitor) + monitor.size(), "drift = [-0.05, 0.03, 0.0]\n");
  recipe += "[reference]\nevery = 4\n";
  std::ofstream(folder / "recipe.toml") << recipe;
  const auto log = folder / "log";
  ASSERT_EQ(run_program({"simulate", folder / "recipe.toml", "-o", folder / "truth"}, log), 0)
      << read_text(log);
  const auto acquire = [&](const std::string& session, const std::string& more) {
    std::vector<std::string> words = {"acquire",        "run", folder / "recipe.toml", "--truth",
                                      folder / "truth", "-o",  folder / session};
    if (!more.empty()) words.push_back(more);
    return words;
  };
  ASSERT_EQ(run_program(acquire("whole", ""), log), 0) << read_text(log);

  const CaptureSession session = read_capture_session(folder / "whole");
  const auto references = session.frames_of(FrameRole::reference);
  ASSERT_GE(references.size(), 4u);
  EXPECT_EQ(session.frames.front().role, FrameRole::reference);
  EXPECT_EQ(session.frames.back().role, FrameRole::reference);
  EXPECT_NE(read_text(references[0].observed), read_text(references[1].observed)) << "the same noise twice";
  const Drift drift = measure_drift(session);
  EXPECT_TRUE(drift.significant);
  const double end = static_cast<double>(session.frames.size()) - 1.0;
  for (const double share : {0.25, 0.5, 1.0}) {
    EXPECT_NEAR(drift.gain_at(share * end)[0], 1.0 - 0.05 * share, 0.005);
    EXPECT_NEAR(drift.gain_at(share * end)[1], 1.0 + 0.03 * share, 0.005);
    EXPECT_NEAR(drift.gain_at(share * end)[2], 1.0, 0.005);
  }

  // Ended where references lie behind and before it.
  ASSERT_TRUE(kill_at_file(acquire("cut", ""), log, "observed/train_005.exr")) << read_text(log);
  ASSERT_EQ(run_program(acquire("cut", "--resume"), log), 0) << read_text(log);
  EXPECT_EQ(folder_difference(folder / "whole", folder / "cut"), "");
}

TEST(AcquireProgram, PrimariesAreNoOutliersAmongFewPatterns) {
  const test::TemporaryFolder folder;
  std::string recipe = tiny_recipe;
  recipe.replace(recipe.find("seed = 5"), 8, "seed = 1");
  recipe.replace(recipe.find("train = 10"), 10, "train = 24");
  write_text_atomically(folder / "recipe.toml", recipe);
  const auto log = folder / "log";
  ASSERT_EQ(run_program({"simulate", folder / "recipe.toml", "-o", folder / "truth"}, log), 0);
  ASSERT_EQ(run_program({"acquire", "run", folder / "recipe.toml", "--truth", folder / "truth", "-o",
                         folder / "session"},
                        log),
            0);
  EXPECT_THAT(read_text(log), testing::HasSubstr("check of 27 photographs: good"));
}

}  // namespace
}  // namespace refield
