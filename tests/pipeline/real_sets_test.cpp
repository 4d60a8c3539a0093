// SPDX-License-Identifier: Apache-2.0
// Real photographs under single light sources, where REFIELD_REAL_DATA names a folder with a checkout per set
// (docs/method/light-stages.md).
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <string>

#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

class RealSets : public testing::TestWithParam<const char*> {};

TEST_P(RealSets, RefieldIsNoWorseThanRegression) {
  const char* data = std::getenv("REFIELD_REAL_DATA");
  if (data == nullptr || !std::filesystem::is_directory(std::filesystem::path(data) / GetParam()))
    GTEST_SKIP() << "REFIELD_REAL_DATA does not name a folder with the set " << GetParam();
  const test::TemporaryFolder folder;
  // The bound on DiLiGenT's 16-bit photographs; those of the others have 8 bits.
  const std::string factor = std::string(GetParam()) == "cat" ? "1.1" : "1.15";
  for (const char* pairs : {"40", "100", "200"}) {
    const std::string command = std::string(REFIELD_REAL_SETS) + " " + GetParam() + " --data '" + data + "/" +
                                GetParam() + "' -o '" + folder.path().string() + "' --program " +
                                REFIELD_PROGRAM + " --crop 12 --pairs " + pairs + " --check " + factor;
    EXPECT_EQ(std::system(command.c_str()), 0) << command;
  }
}

INSTANTIATE_TEST_SUITE_P(, RealSets, testing::Values("cat", "relief", "face", "led"),
                         [](const auto& set) { return std::string(set.param); });

}  // namespace
}  // namespace refield
