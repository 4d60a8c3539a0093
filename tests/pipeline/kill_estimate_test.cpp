// SPDX-License-Identifier: Apache-2.0
// kill -9 at any step on disk of an estimation: with --resume it ends in the same bytes as one that was left
// in peace.
#include <gtest/gtest.h>

#include "core/base/files.h"
#include "core/base/rng.h"
#include "tests/pipeline/program.h"
#include "tests/support/synthetic_capture.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

namespace fs = std::filesystem;
using namespace test;

TEST(EstimateProgram, KilledAtTenStepsItEndsInTheSameBytes) {
  const test::TemporaryFolder folder;
  const auto lights = random_lights(50, 24, 18, 7);
  write_capture(folder / "session",
                field_of_boxes(20, 40, lights[0].domain(), {{0, 0, 12, 9}, {8, 6, 20, 11}, {5, 3, 7, 5}}, 2),
                lights, 0.02);
  const fs::path log = folder / "log";
  const auto estimate = [&](const std::string& field, std::vector<std::string> more) {
    std::vector<std::string> arguments = {"estimate", folder / "session", "-o", folder / field};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  };
  const long steps = count_steps(estimate("whole.rfield", {}), log);
  ASSERT_GT(steps, 10) << read_text(log);
  const std::string whole = read_text(folder / "whole.rfield");

  Rng random(20042);
  int kills = 0, took_over = 0;
  for (int attempt = 0; attempt < kills_asked_for(); ++attempt) {
    // At any step, and first when a finished band lies on disk.
    const auto step = 1 + static_cast<long>(random.uniform() * static_cast<double>(steps));
    const bool struck = attempt == 0 ? kill_at_file(estimate("cut.rfield", {}), log, "cut.rfield.partial")
                                     : kill_at_step(estimate("cut.rfield", {"--resume"}), log, step);
    if (struck) {
      ++kills;
      took_over += fs::exists(folder / "cut.rfield.partial");
      EXPECT_TRUE(!fs::exists(folder / "cut.rfield") || read_text(folder / "cut.rfield") == whole)
          << "a killed run left a damaged field";
      continue;
    }
    EXPECT_EQ(read_text(folder / "cut.rfield"), whole);  // what was left to do took fewer steps
    fs::remove(folder / "cut.rfield");
  }
  EXPECT_GT(kills, 0);
  EXPECT_GT(took_over, 0) << "no kill fell while finished bands lay on disk";
  EXPECT_EQ(run_program(estimate("cut.rfield", {"--resume"}), log), 0) << read_text(log);
  EXPECT_EQ(read_text(folder / "cut.rfield"), whole);
  EXPECT_FALSE(fs::exists(folder / "cut.rfield.partial"));
}

}  // namespace
}  // namespace refield
