// SPDX-License-Identifier: Apache-2.0
// Rig files of 'refield acquire run': what is wrong in them is said before any device is touched.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/base/files.h"
#include "tests/pipeline/program.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

using ::testing::HasSubstr;

struct Mistake {
  const char* name;
  const char* monitor;
  const char* lights;
  const char* message;
};

class SessionFileMistake : public ::testing::TestWithParam<Mistake> {};

TEST_P(SessionFileMistake, IsNamedWithLineAndRemedy) {
  const test::TemporaryFolder folder;
  write_text_atomically(folder / "rig.toml",
                        std::string("[session]\noutput = \"out\"\ncalibration = \"c.toml\"\n") +
                            "[camera]\ndevice = \"no such camera\"\n[monitor]\n" + GetParam().monitor +
                            "\n[lights]\n" + GetParam().lights + "\n");
  EXPECT_EQ(test::run_program({"acquire", "run", folder / "rig.toml"}, folder / "log"), 2);
  EXPECT_THAT(read_text(folder / "log"), HasSubstr(GetParam().message));
  EXPECT_FALSE(std::filesystem::exists(folder / "out"));
}

TEST(SessionFile, GenicamCamerasHaveKeysOfTheirOwn) {
  const auto message = [](const std::string& camera) {
    const test::TemporaryFolder folder;
    write_text_atomically(
        folder / "rig.toml",
        "[session]\noutput = \"out\"\ncalibration = \"c.toml\"\n[camera]\n" + camera +
            "\n[controls]\nGamma = 1.0\nGainAuto = \"Off\"\n[lights]\nimages = \"lights\"\n");
    EXPECT_EQ(test::run_program({"acquire", "run", folder / "rig.toml"}, folder / "log"), 2);
    return read_text(folder / "log");
  };
  EXPECT_THAT(message("device = \"genicam:S1\"\ntrigger = \"Line1\"\nwidth = 640"),
              HasSubstr("rig.toml:7: [camera] width"));
  EXPECT_THAT(message("device = \"video0\"\ntrigger = \"Line1\""), HasSubstr("rig.toml:6: [camera] trigger"));
  EXPECT_THAT(message("device = \"genicam:127.0.0.99\""), HasSubstr("genicam:127.0.0.99: cannot be opened"));
}

constexpr const char* some_lights = "images = \"lights\"";
INSTANTIATE_TEST_SUITE_P(
    Tables, SessionFileMistake,
    ::testing::Values(
        Mistake{"UnknownKey", "conector = \"HDMI-A-1\"", some_lights, "rig.toml:7: [monitor] conector"},
        Mistake{"WindowWithConnector", "window = true\nconnector = \"HDMI-A-1\"", some_lights,
                "rig.toml:8: [monitor] connector"},
        Mistake{"DisplayWithoutWindow", "display = 1", some_lights, "window = true"},
        Mistake{"NoLights", "width = 32", "test_images = \"held_out\"", "no light maps are given"},
        // A sound file: the camera is the first thing that is missing.
        Mistake{"NoCamera", "window = true", some_lights, "no such camera"}),
    [](const auto& mistake) { return std::string(mistake.param.name); });

}  // namespace
}  // namespace refield
