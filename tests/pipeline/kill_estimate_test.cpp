// SPDX-License-Identifier: Apache-2.0
// kill -9 at any moment of an estimation: with --resume it ends in the same bytes as one that was left in
// peace.
#include <gtest/gtest.h>

#include <chrono>

#include "core/base/files.h"
#include "core/base/rng.h"
#include "tests/pipeline/program.h"
#include "tests/support/synthetic_capture.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

namespace fs = std::filesystem;
using namespace test;

TEST(EstimateProgram, KilledAtTenMomentsItEndsInTheSameBytes) {
  const TemporaryFolder folder;
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
  const auto start = std::chrono::steady_clock::now();
  ASSERT_EQ(run_program(estimate("whole.rfield", {}), log), 0) << read_text(log);
  const std::chrono::duration<double> duration = std::chrono::steady_clock::now() - start;
  const std::string whole = read_text(folder / "whole.rfield");

  const int kills_wanted = kills_asked_for();
  const int max_attempts = 6 * kills_wanted;
  Rng random(20042);
  int kills = 0, took_over = 0;
  for (int attempt = 0; kills < kills_wanted && attempt < max_attempts; ++attempt) {
    RunningProgram program(estimate("cut.rfield", {"--resume"}), log);
    // At any moment, and every other time when the first finished bands lie on disk.
    const bool struck = attempt % 2 == 0 ? program.kill_after(duration * random.uniform())
                                         : program.kill_at(folder / "cut.rfield.partial", duration);
    if (struck) {
      ++kills;
      took_over += fs::exists(folder / "cut.rfield.partial");
      EXPECT_TRUE(!fs::exists(folder / "cut.rfield") || read_text(folder / "cut.rfield") == whole)
          << "a killed run left a damaged field";
      continue;
    }
    EXPECT_EQ(read_text(folder / "cut.rfield"), whole);  // it got through before the blow
    fs::remove(folder / "cut.rfield");
  }
  EXPECT_EQ(kills, kills_wanted);
  EXPECT_GT(took_over, 0) << "no kill fell while finished bands lay on disk";
  EXPECT_EQ(run_program(estimate("cut.rfield", {"--resume"}), log), 0) << read_text(log);
  EXPECT_EQ(read_text(folder / "cut.rfield"), whole);
  EXPECT_FALSE(fs::exists(folder / "cut.rfield.partial"));
}

}  // namespace
}  // namespace refield
