// SPDX-License-Identifier: Apache-2.0
// kill -9 at any step on disk of a capture: with --resume it ends in the same bytes as one that was left in
// peace.
#include <gtest/gtest.h>

#include <fstream>

#include "core/base/files.h"
#include "core/base/rng.h"
#include "core/image/image_io.h"
#include "core/session/capture_session.h"
#include "tests/pipeline/program.h"
#include "tests/pipeline/tiny_recipe.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

namespace fs = std::filesystem;
using namespace test;

class CaptureProgram : public ::testing::Test {
 protected:
  void SetUp() override {
    write_text_atomically(folder / "recipe.toml", tiny_recipe);
    ASSERT_EQ(run_program({"simulate", folder / "recipe.toml", "-o", folder / "truth"}, log), 0)
        << read_text(log);
    steps = count_steps(acquire("whole"), log);
    ASSERT_GT(steps, 100) << read_text(log);
  }
  std::vector<std::string> acquire(const std::string& session, std::vector<std::string> more = {}) const {
    std::vector<std::string> arguments = {"acquire",        "run", folder / "recipe.toml", "--truth",
                                          folder / "truth", "-o",  folder / session,       "--keep-raw",
                                          "--auto-mask"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  }
  test::TemporaryFolder folder;
  fs::path log = folder / "log";
  long steps = 0;  // on disk, of a whole capture
};

TEST_F(CaptureProgram, KilledAtTenStepsItEndsInTheSameBytes) {
  Rng random(20041);
  int sessions = 0;
  for (int kill = 0; kill < kills_asked_for(); ++kill) {
    const std::string session = "cut_" + std::to_string(sessions);
    const auto step = 1 + static_cast<long>(random.uniform() * static_cast<double>(steps));
    if (kill_at_step(acquire(session, {"--resume"}), log, step)) continue;
    // What was left to do took fewer steps.
    EXPECT_EQ(folder_difference(folder / "whole", folder / session), "");
    ++sessions;
  }
  EXPECT_LT(sessions, kills_asked_for()) << "no run was killed";
  const std::string session = "cut_" + std::to_string(sessions);
  EXPECT_EQ(run_program(acquire(session, {"--resume"}), log), 0) << read_text(log);
  EXPECT_EQ(folder_difference(folder / "whole", folder / session), "");
}

TEST_F(CaptureProgram, OverwritesNothingUnasked) {
  const std::string journal = read_text(folder / "whole/journal");
  EXPECT_EQ(run_program(acquire("whole"), log), 2);
  EXPECT_NE(read_text(log).find("--resume"), std::string::npos) << read_text(log);
  EXPECT_EQ(run_program(acquire("whole", {"--resume"}), log), 0) << read_text(log);
  EXPECT_NE(read_text(log).find("already complete"), std::string::npos) << read_text(log);
  EXPECT_EQ(run_program(acquire("whole", {"--resume", "--exposures", "0.01,0.04"}), log), 2);
  EXPECT_EQ(read_text(folder / "whole/journal"), journal);
  EXPECT_EQ(run_program(acquire("whole", {"--force", "--exposures", "0.01,0.04"}), log), 0) << read_text(log);
  EXPECT_NE(read_text(folder / "whole/journal"), journal);
}

TEST_F(CaptureProgram, HdrOfKeptFramesIsThePhotograph) {
  const std::string plan = read_text(folder / "whole/plan.toml");
  const auto start = plan.find("seconds = [") + 11;
  std::string seconds = plan.substr(start, plan.find(']', start) - start);
  std::erase(seconds, ' ');
  const std::vector<std::string> hdr = {"acquire",
                                        "import",
                                        (folder / "whole/raw/train_003_*.png").string(),
                                        "-o",
                                        (folder / "merged.exr").string(),
                                        "--exposures",
                                        seconds,
                                        "--response",
                                        (folder / "whole/calibration.toml").string()};
  ASSERT_EQ(run_program(hdr, log), 0) << read_text(log);
  const Image merged = read_photograph(folder / "merged.exr").radiance;
  const Image ambient = read_photograph(folder / "whole/ambient.exr").radiance;
  const Image observed = read_photograph(folder / "whole/observed/train_003.exr").radiance;
  for (std::size_t i = 0; i < merged.values.size(); ++i)
    ASSERT_EQ(merged.values[i] - ambient.values[i], observed.values[i]) << i;
}

}  // namespace
}  // namespace refield
