// SPDX-License-Identifier: Apache-2.0
// From a calibration to a capture that uses it, as a person runs them.
#include <gmock/gmock.h>

#include <cmath>

#include "core/base/files.h"
#include "core/image/image_io.h"
#include "core/session/capture_session.h"
#include "tests/pipeline/program.h"
#include "tests/pipeline/tiny_recipe.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

using namespace test;
using testing::HasSubstr;

class CalibrateProgram : public testing::Test {
 protected:
  /// A truth and recipe of devices that do nothing as they should; `monitor` adds to the recipe's.
  void make_rig(const std::string& monitor) {
    std::string recipe = tiny_recipe;
    recipe.replace(recipe.find("width = 24\nheight = 18"), 22, "width = 48\nheight = 36");
    recipe.replace(
        recipe.find("height_m = 0.6"), 14,
        "height_m = 0.6\nfalloff = 0.1\npwm_hz = 240\npwm_depth = 0.2\nlatency_ms = 58\n" + monitor);
    recipe += "[sensor]\nsensitivity = 2e6\ncontrol_latency_frames = 2\nresponse_gamma = 1.6\n";
    write_text_atomically(folder_ / "recipe.toml", recipe);
    ASSERT_EQ(run({"simulate", folder_ / "recipe.toml", "-o", folder_ / "truth"}), 0) << log();
  }
  int run(std::vector<std::string> words) { return run_program(std::move(words), folder_ / "log"); }
  int calibrate(std::vector<std::string> more = {}) {
    std::vector<std::string> words = {"acquire",
                                      "calibrate",
                                      folder_ / "recipe.toml",
                                      "--truth",
                                      folder_ / "truth",
                                      "-o",
                                      folder_ / "calibration.toml",
                                      "--level-step",
                                      "15"};
    words.insert(words.end(), more.begin(), more.end());
    return run(words);
  }
  /// The session's photograph under white.
  Photograph white_of(const std::string& session) {
    for (const CaptureFrame& frame : read_capture_session(folder_ / session).frames)
      if (frame.kind == "white") return read_photograph(frame.observed);
    throw std::runtime_error("no white light in " + session);
  }
  std::string log() { return read_text(folder_ / "log"); }

  test::TemporaryFolder folder_;
};

TEST_F(CalibrateProgram, ACaptureWithTheMeasuredCalibrationAgreesWithOneThatKnowsTheTruth) {
  make_rig("");
  ASSERT_EQ(calibrate(), 0) << log();
  EXPECT_THAT(log(), HasSubstr("takes effect after 2 more frames"));
  EXPECT_THAT(log(), HasSubstr("whole multiples of 4.167 ms"));
  EXPECT_THAT(read_text(folder_ / "calibration.html"), HasSubstr("\"superposition_holds\":true"));
  EXPECT_EQ(calibrate(), 2) << "files that exist are kept";

  const std::vector<std::string> capture = {
      "acquire", "run", folder_ / "recipe.toml", "--truth", folder_ / "truth", "--max-noise", "3%", "-o"};
  auto knowing = capture, measured = capture;
  knowing.push_back(folder_ / "knowing");
  measured.insert(measured.end(), {folder_ / "measured", "--calibration", folder_ / "calibration.toml"});
  ASSERT_EQ(run(knowing), 0) << log();
  EXPECT_THAT(log(), HasSubstr("the scene's range of 1:"));
  ASSERT_EQ(run(measured), 0) << log();
  // The measured unit of radiance is another one: by a factor for all.
  const Photograph a = white_of("knowing");
  const Photograph b = white_of("measured");
  double ab = 0.0, aa = 0.0, bb = 0.0, noise_a = 0.0, noise_b = 0.0;
  for (std::size_t i = 0; i < a.radiance.values.size(); ++i) {
    ab += a.radiance.values[i] * b.radiance.values[i];
    aa += a.radiance.values[i] * a.radiance.values[i];
    bb += b.radiance.values[i] * b.radiance.values[i];
    noise_a += a.sigma.values[i] * a.sigma.values[i];
    noise_b += b.sigma.values[i] * b.sigma.values[i];
  }
  const double difference = std::sqrt(1.0 - ab * ab / (aa * bb));
  const double by_chance = std::sqrt(noise_a / aa + noise_b / bb);
  constexpr double calibration_error = 0.005;
  EXPECT_LT(difference, std::hypot(1.05 * by_chance, calibration_error)) << "noise " << by_chance;
}

TEST_F(CalibrateProgram, ADisplayThatDimsItselfEndsWithStatusTwoAndAPageThatSaysSo) {
  make_rig("dimming = 0.05");
  EXPECT_EQ(calibrate({"--json"}), 2);
  EXPECT_THAT(log(), HasSubstr("light is not additive"));
  EXPECT_THAT(log(), HasSubstr("\"superposition_holds\": false"));
  EXPECT_THAT(read_text(folder_ / "calibration.html"), HasSubstr("\"superposition_holds\":false"));
  EXPECT_TRUE(std::filesystem::exists(folder_ / "calibration.toml"));
}

}  // namespace
}  // namespace refield
