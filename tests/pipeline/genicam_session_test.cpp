// SPDX-License-Identifier: Apache-2.0
// A session of the program with a GenICam camera, which speaks GigE Vision over the loopback interface, and a
// window for a monitor.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "core/base/files.h"
#include "tests/pipeline/program.h"
#include "tests/pipeline/tiny_recipe.h"
#include "tests/support/fake_genicam.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/virtual_screen.h"

namespace refield::test {
namespace {

using ::testing::HasSubstr;

TEST(GenicamSession, IsResumedAfterTheProgramWasKilledAndStillHoldsTheCamera) {
  if (!is_installed("Xvfb")) GTEST_SKIP() << "needs Xvfb";
  enter_private_network();
  const VirtualScreen screen(160, 120);
  ASSERT_TRUE(screen.is_up());
  // Grey of 12 bits, in the middle of the range.
  const FakeGenicam fake("127.0.0.1", "S1", [](const FakeExposure& exposure) {
    for (std::size_t i = 0; i < exposure.bytes.size(); ++i) exposure.bytes[i] = i % 2 ? 4 : 0;
  });
  const TemporaryFolder folder;
  const auto run = [&](std::vector<std::string> arguments) {
    const int status = run_program(std::move(arguments), folder / "log");
    EXPECT_EQ(status, 0) << read_text(folder / "log");
  };
  write_text_atomically(folder / "recipe.toml",
                        std::string(tiny_recipe) + "[sensor]\nlayout = \"grey\"\nbits = 12\n");
  run({"simulate", folder / "recipe.toml", "-o", folder / "truth"});
  run({"acquire", "run", folder / "recipe.toml", "--truth", folder / "truth", "-o", folder / "rig"});
  write_text_atomically(
      folder / "rig.toml",
      "[session]\noutput = \"session\"\ncalibration = \"rig/calibration.toml\"\nreference_every = 0\n"
      "[camera]\ndevice = \"genicam:127.0.0.1\"\npixel_format = \"Mono12\"\nregion = [0, 0, 64, 48]\n"
      "fps = 60\ntrigger = \"Software\"\n[controls]\nBlackLevel = 16\n"
      "[monitor]\nwindow = true\nwidth = 16\nheight = 12\n"
      "[lights]\nsession = \"truth\"\n[exposures]\nseconds = [0.002, 0.008]\n");
  ASSERT_TRUE(kill_at_file({"acquire", "run", folder / "rig.toml"}, folder / "log", "observed/"))
      << read_text(folder / "log");
  run({"acquire", "run", folder / "rig.toml", "--resume"});
  run({"info", folder / "session"});
  EXPECT_THAT(read_text(folder / "log"), HasSubstr("64"));
  EXPECT_THAT(read_text(folder / "session/plan.toml"),
              HasSubstr("Aravis Fake (S1) Mono12 window 0,0 BlackLevel=16"));
}

}  // namespace
}  // namespace refield::test
