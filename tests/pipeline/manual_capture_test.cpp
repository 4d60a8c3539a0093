// SPDX-License-Identifier: Apache-2.0
// A capture by hand: patterns are made and shown, a camera with a contrast curve takes bracketed JPEG files
// with EXIF, and what is imported is the scene's radiance.
#include <OpenImageIO/imageio.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <unistd.h>

#include <cmath>
#include <map>
#include <regex>

#include "acquire/series/capture_time.h"
#include "core/base/files.h"
#include "core/image/image_io.h"
#include "core/image/tone_map.h"
#include "core/session/capture_session.h"
#include "tests/pipeline/program.h"
#include "tests/pipeline/tiny_recipe.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/virtual_screen.h"

namespace refield {
namespace {

using test::run_program;
using test::TemporaryFolder;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
namespace fs = std::filesystem;

constexpr ClockSeconds noon = 1'087'812'000.0;
constexpr double clock_ahead = 137.0;  // of the camera, seconds
constexpr double every = 6.0;          // seconds per pattern

/// sRGB, then the S of a camera's picture style.
double contrast(double light) {
  const double x = srgb_from_linear(static_cast<float>(std::clamp(light, 0.0, 1.0)));
  return x - 0.48 * std::sin(2.0 * M_PI * x) * x * (1.0 - x);
}

void write_jpeg(const fs::path& path, const Image& radiance, double seconds, ClockSeconds time,
                int orientation = 1) {
  OIIO::ImageSpec spec(radiance.width, radiance.height, 3, OIIO::TypeDesc::UINT8);
  spec.attribute("CompressionQuality", 98);
  spec.attribute("jpeg:subsampling", "4:4:4");
  spec.attribute("ExposureTime", static_cast<float>(seconds));
  if (orientation != 1) spec.attribute("Orientation", orientation);
  std::string text = text_from_clock_seconds(time).substr(0, 19);
  text[4] = text[7] = ':';
  text[10] = ' ';
  spec.attribute("DateTime", text);
  std::vector<std::uint8_t> levels;
  for (const float value : radiance.values)
    levels.push_back(static_cast<std::uint8_t>(std::lround(255.0 * contrast(value * seconds))));
  auto output = OIIO::ImageOutput::create(path.string());
  ASSERT_TRUE(output && output->open(path.string(), spec));
  ASSERT_TRUE(output->write_image(OIIO::TypeDesc::UINT8, levels.data()) && output->close());
}

/// The scene under the first hundred patterns, without references, 30 of them held out, as a camera on a
/// tripod writes it: IMG_1000.jpg and so on.
class ManualCapture : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = std::make_unique<TemporaryFolder>();
    std::string recipe = test::tiny_recipe;
    recipe.insert(recipe.find("count = 4"), "ambient_frames = 1\n");
    write_text_atomically(at("recipe.toml"), recipe);
    const std::vector<std::vector<std::string>> commands = {
        {"acquire", "lights", "--starter", "--light-size", "16x12", "-o", at("lights"), "--png",
         at("patterns")},
        {"simulate", at("recipe.toml"), "-o", at("truth")},
        {"acquire", "run", at("recipe.toml"), "--truth", at("truth"), "--light", at("hundred"), "-o",
         at("captured"), "--exposures", "0.02,0.08,0.32"}};
    for (const auto& command : commands) {
      if (command[1] == "run") {
        fs::create_directories(at("hundred"));
        const auto all = expand_glob(at("lights/*.exr"));
        for (int i = 0; i < 100; ++i) fs::copy(all[i].path, at("hundred"));
      }
      ASSERT_EQ(run_program(command, at("log")), 0) << read_text(at("log"));
    }
    fs::create_directories(at("shots"));
    fs::create_directories(at("shown"));
    Image black(24, 18, 3);
    photograph(black, 0);
    std::map<std::string, ClockSeconds> shown;
    int place = 1;
    const CaptureSession session = read_capture_session(at("captured"));
    for (const CaptureFrame& frame : session.frames) {
      if (frame.role == FrameRole::reference) continue;
      photograph(read_photograph(frame.observed).radiance, place);
      fs::copy(at("patterns/" + frame.name + ".png"), at("shown/" + frame.name + ".png"));
      shown[frame.name] = noon + every * (place + 0.5);
      ++place;
    }
    write_times(at("shown"), shown);
  }
  static void TearDownTestSuite() { folder_.reset(); }
  static std::string at(const std::string& name) { return *folder_ / name; }

  static void photograph(const Image& radiance, int place) {
    Image seen(enlarged * radiance.width, enlarged * radiance.height, 3);
    for (int y = 0; y < seen.height; ++y)
      for (int x = 0; x < seen.width; ++x)
        for (int c = 0; c < 3; ++c)
          seen.at(x, y, c) = static_cast<float>(
              40.0 * (std::max(radiance.at(x / enlarged, y / enlarged, c), 0.0f) + ambient));
    int shot = 0;
    for (const double seconds : {1.0 / 60.0, 1.0 / 15.0, 0.3}) {
      const std::string name = "shots/IMG_" + std::to_string(1000 + 3 * place + shot) + ".jpg";
      write_jpeg(at(name), seen, seconds, noon + every * place + 1.0 + shot + clock_ahead);
      ++shot;
    }
  }

  /// Relative RMS error of the imported photographs, with the factor that fits best.
  static double error_of(const fs::path& session) {
    const CaptureSession imported = read_capture_session(session);
    double rt = 0.0, rr = 0.0, tt = 0.0;
    for (const CaptureFrame& frame : imported.frames) {
      const Photograph photograph = read_photograph(frame.observed);
      const Image truth = read_image(at("captured/observed/" + frame.name + ".exr"));
      for (int y = 0; y < photograph.radiance.height; ++y)
        for (int x = 0; x < photograph.radiance.width; ++x)
          for (int c = 0; c < 3; ++c) {
            if (!std::isfinite(photograph.sigma.at(x, y, c))) continue;
            const double r = photograph.radiance.at(x, y, c), t = truth.at(x / enlarged, y / enlarged, c);
            rt += r * t;
            rr += r * r;
            tt += t * t;
          }
    }
    return std::sqrt(1.0 - rt * rt / (rr * tt));
  }

  static constexpr double ambient = 0.002;
  static constexpr int enlarged = 4;  // JPEG codes blocks of 8 pixels, and a camera's pixels are small
  static std::unique_ptr<TemporaryFolder> folder_;
  const TemporaryFolder out_;
  std::string log() const { return read_text(out_ / "log"); }
  int run(std::vector<std::string> words) const { return run_program(std::move(words), out_ / "log"); }
};

std::unique_ptr<TemporaryFolder> ManualCapture::folder_;

TEST_F(ManualCapture, TheStarterSetIsWhatItsImagesShow) {
  // 180 patterns, three primaries and seven times white.
  EXPECT_EQ(expand_glob(at("lights")).size(), 190U);
  EXPECT_EQ(expand_glob(at("lights/primary_*.exr")).size(), 3U);
  const std::vector<fs::path> lights = expand_globs({at("lights")});
  EXPECT_EQ(lights[3].stem(), "reference");  // in the order in which they are shown
  EXPECT_EQ(lights[34].stem(), "test_029_reference");
  EXPECT_EQ(lights.back().stem(), "train_149_reference");
  for (const GlobMatch& match : expand_glob(at("patterns"))) {
    // read_image() decodes PNG from sRGB.
    const Image decoded = read_image(match.path);
    const Image light = read_image(at("lights/" + match.path.stem().string() + ".exr"));
    EXPECT_EQ(decoded.values, light.values) << match.path;
    EXPECT_GT(*std::ranges::max_element(light.values), 0.5f);
  }
  ASSERT_EQ(run({"acquire", "lights", "--starter", "-o", at("lights")}), 2);
  EXPECT_THAT(log(), HasSubstr("train_000.exr: already exists"));
}

TEST_F(ManualCapture, ImportedByOrderTheCamerasCurveIsEstimated) {
  ASSERT_EQ(run({"acquire", "import", at("shots"), "--light", at("shown"), "--ambient-first", "--response",
                 "srgb", "-o", out_ / "doubtful"}),
            0)
      << log();
  EXPECT_THAT(log(), HasSubstr("contradict 'srgb' by"));
  ASSERT_EQ(run({"acquire", "import", at("shots"), "--light", at("shown"), "--ambient-first", "-o",
                 out_ / "session"}),
            0)
      << log();
  EXPECT_THAT(log(), HasSubstr("Its response was estimated from 5 brackets"));
  const double before = error_of(out_ / "doubtful"), after = error_of(out_ / "session");
  RecordProperty("before", std::to_string(before));
  RecordProperty("after", std::to_string(after));
  EXPECT_GT(before, 0.10);
  constexpr double rounding_and_jpeg = 0.04;  // 8 bits, quality 98, without a camera's own noise
  EXPECT_LT(after, rounding_and_jpeg);

  ASSERT_EQ(run({"acquire", "import", at("shots"), "-o", out_ / "camera.toml"}), 0) << log();
  EXPECT_THAT(log(), HasSubstr("response estimated from"));
  ASSERT_EQ(run({"acquire", "import", at("shots"), "--light", at("shown"), "--ambient-first", "--response",
                 out_ / "camera.toml", "-o", out_ / "calibrated"}),
            0)
      << log();
  EXPECT_THAT(log(), Not(HasSubstr("note: the exposures contradict")));
  EXPECT_LT(error_of(out_ / "calibrated"), rounding_and_jpeg);
}

TEST_F(ManualCapture, WithGapsPhotographsAndPatternsArePairedByTime) {
  const fs::path shots = out_ / "shots";
  fs::create_directories(shots);
  for (const GlobMatch& match : expand_glob(at("shots"))) {
    const int number = std::stoi(match.path.stem().string().substr(4)) - 1000;
    if (number / 3 != 31 && number / 3 != 47) fs::copy(match.path, shots / match.path.filename());
  }
  ASSERT_EQ(
      run({"acquire", "import", shots, "--light", at("shown"), "--ambient-first", "-o", out_ / "ordered"}), 0)
      << log();
  EXPECT_THAT(log(), HasSubstr("lights without photographs, which are left out: test_027, train_013\n"));
  EXPECT_EQ(read_capture_session(out_ / "ordered").frames.size(), 94U);
  EXPECT_EQ(run({"info", out_ / "ordered"}), 0) << log();
  EXPECT_THAT(log(), HasSubstr("left out: test_027, train_013"));
  ASSERT_EQ(run({"acquire", "import", shots, "--ambient-first", "-o", out_ / "hdr"}), 0) << log();
  ASSERT_EQ(run({"acquire", "import", out_ / "hdr", "--light", at("shown"), "--pair-by", "time", "--offset",
                 "auto", "-o", out_ / "session"}),
            0)
      << log();
  const CaptureSession session = read_capture_session(out_ / "session");
  EXPECT_EQ(session.frames.size(), 94U);
  EXPECT_EQ(session.light.parameterisation, Parameterisation::monitor);
  for (const CaptureFrame& frame : session.frames) {
    const int place = (std::stoi(frame.name.substr(4)) - 1000) / 3 - 1;
    const fs::path light =
        at("lights/" + expand_glob(at("shown/*.png")).at(place).path.stem().string() + ".exr");
    EXPECT_EQ(read_image(frame.illumination).values, read_image(light).values) << frame.name;
  }
}

/// As an interval timer that starts early, stops late, misses one pattern and takes another twice, without
/// times.
TEST_F(ManualCapture, BlackMissingAndRepeatedBracketsAreNamed) {
  const fs::path shots = out_ / "shots", lights = out_ / "lights";
  fs::create_directories(shots);
  fs::create_directories(lights);
  for (const GlobMatch& match : expand_glob(at("shown"))) fs::copy(match.path, lights);
  int number = 2000;
  const auto take = [&](int place) {
    for (int shot = 0; shot < 3; ++shot)
      fs::copy(at("shots/IMG_" + std::to_string(1000 + 3 * place + shot) + ".jpg"),
               shots / ("IMG_" + std::to_string(number++) + ".jpg"));
  };
  take(0);
  take(0);
  for (int place = 1; place <= 96; ++place) {
    if (place != 41) take(place);
    if (place == 81) take(place);
  }
  take(0);
  ASSERT_EQ(run({"acquire", "import", shots, "--light", lights, "--ambient-first", "-o", out_ / "session"}),
            0)
      << log();
  EXPECT_THAT(log(), AllOf(HasSubstr("IMG_2003.jpg, " + (shots / "IMG_2294.jpg").string()),
                           HasSubstr("lights without photographs, which are left out: train_0"),
                           HasSubstr("(train_047)\n")));
  EXPECT_EQ(read_capture_session(out_ / "session").frames.size(), 95U);
}

TEST_F(ManualCapture, PhotographsOfSeveralOrientationsAreRefused) {
  const fs::path shots = out_ / "shots";
  fs::copy(at("shots"), shots);
  const Image grey(96, 72, 3, 0.5f);
  for (int shot = 0; shot < 3; ++shot)
    write_jpeg(shots / ("IMG_" + std::to_string(1150 + shot) + ".jpg"), grey,
               shot == 2 ? 0.3 : (1 + 3 * shot) / 60.0, noon, 3);
  ASSERT_EQ(
      run({"acquire", "import", shots, "--light", at("shown"), "--ambient-first", "-o", out_ / "session"}),
      2);
  EXPECT_THAT(log(), HasSubstr("IMG_1150.jpg: was taken with EXIF Orientation 3, but"));
}

TEST_F(ManualCapture, AnAmbientBracketWithRoomLightIsNamed) {
  const fs::path shots = out_ / "shots", dark = out_ / "dark";
  fs::copy(at("shots"), shots);
  fs::create_directories(dark);
  for (int shot = 0; shot < 3; ++shot)  // the photographs under a bright pattern
    fs::rename(shots / ("IMG_" + std::to_string(1003 + shot) + ".jpg"),
               dark / ("IMG_" + std::to_string(1003 + shot) + ".jpg"));
  ASSERT_EQ(
      run({"acquire", "import", shots, "--light", at("shown"), "--ambient", dark, "-o", out_ / "session"}), 0)
      << log();
  EXPECT_THAT(log(),
              AllOf(HasSubstr("IMG_1003.jpg: "), HasSubstr("darker than this one of the ambient light")));
}

TEST_F(ManualCapture, HdrRefusesTimesThatThePhotographsContradict) {
  const std::vector<std::string> images = {at("shots/IMG_1012.jpg"), at("shots/IMG_1013.jpg")};
  EXPECT_EQ(run({"acquire", "import", images[0], images[1], "--exposures", "0.0666,0.0166", "-o",
                 out_ / "view.exr"}),
            2);
  EXPECT_THAT(log(), AllOf(HasSubstr("IMG_1012.jpg: is darker than"), HasSubstr("swapped")));
  EXPECT_EQ(run({"acquire", "import", images[0], images[0], "--exposures", "0.0166,0.0666", "-o",
                 out_ / "view.exr"}),
            2);
  EXPECT_THAT(log(), HasSubstr("no brighter"));
  EXPECT_FALSE(fs::exists(out_ / "view.exr"));
  EXPECT_EQ(run({"acquire", "import", images[1], "-o", out_ / "view.exr"}), 0);
  EXPECT_THAT(log(), HasSubstr("note: 8-bit files with one exposure"));
}

TEST_F(ManualCapture, PatternsAreShownOnAScreenWithTheirTimes) {
  if (!test::is_installed("Xvfb") || !test::is_installed("xwd") || !test::is_installed("xdotool"))
    GTEST_SKIP()
        << "SKIPPED: Xvfb, xwd or xdotool is not installed (Debian packages xvfb, x11-apps, xdotool)";
  ::unsetenv("WAYLAND_DISPLAY");
  constexpr int width = 320, height = 200, scale = 16, left = 32, top = 4;  // 16×12 texels: 256×192 pixels
  const test::VirtualScreen screen(width, height);
  ASSERT_TRUE(screen.is_up()) << "Xvfb does not start";
  fs::create_directories(out_ / "patterns");
  for (const char* name : {"train_000", "train_001", "test_029"})
    fs::copy(at("patterns/" + std::string(name) + ".png"), out_ / "patterns" / (std::string(name) + ".png"));
  const Image pattern = read_image(out_ / "patterns/train_000.png");
  const std::vector<std::uint8_t> levels = tone_mapped(pattern, {});
  std::vector<std::uint8_t> wanted(std::size_t{3} * width * height);
  for (int y = 0; y < 12 * scale; ++y)
    for (int x = 0; x < 16 * scale; ++x)
      for (int c = 0; c < 3; ++c)
        wanted[(static_cast<std::size_t>(y + top) * width + x + left) * 3 + c] =
            levels[(y / scale * 16 + x / scale) * 3 + c];
  // Patterns change by keys, and what the program prints says when: nothing is missed on a busy machine.
  test::OutputPipe output(out_ / "output");
  test::RunningProgram program({"acquire", "show", out_ / "patterns", "--from", "train_000"}, output.path());
  const auto press_space = [] {
    ASSERT_EQ(test::finish_program(test::start_program({"xdotool", "key", "space"})), 0);
  };
  output.read_until("black (photograph the ambient light)");
  press_space();
  output.read_until("train_000     2 of 3");  // files come by name: test_029 lies before it
  EXPECT_EQ(test::screenshot(out_ / "screen.xwd", width, height), wanted);
  press_space();
  output.read_until("train_001     3 of 3");
  press_space();
  EXPECT_EQ(program.wait(), 0);
  const auto times = read_times(out_ / "patterns");
  ASSERT_EQ(times.size(), 2U);
  EXPECT_LT(times.at("train_000"), times.at("train_001"));
  // By the clock, to the end: each stands no shorter than it must.
  ASSERT_EQ(run({"acquire", "show", out_ / "patterns", "--every", "0.2s", "--start-in", "0.01s"}), 0)
      << log();
  const auto timed = read_times(out_ / "patterns");
  ASSERT_EQ(timed.size(), 3U);
  EXPECT_GE(timed.at("train_000") - timed.at("test_029"), 0.19);  // times are rounded
}

TEST(SessionFileTemplate, IsReadByTheProgramWithAllItsKeys) {
  const TemporaryFolder folder;
  const auto message = [&](const std::vector<std::string>& words) {
    EXPECT_EQ(run_program(words, folder / "log"), 2);
    return read_text(folder / "log");
  };
  ASSERT_EQ(run_program({"acquire", "devices", "-o", folder / "rig.toml"}, folder / "log"), 0)
      << read_text(folder / "log");
  EXPECT_THAT(message({"acquire", "devices", "-o", folder / "rig.toml"}), HasSubstr("exists"));
  std::string text = std::regex_replace(read_text(folder / "rig.toml"), std::regex("\ndevice = \"[^\"]*\""),
                                        "\ndevice = \"no such camera\"");
  write_text_atomically(folder / "rig.toml", text);
  // The camera is the first thing that is missing: the file was read to its end.
  EXPECT_THAT(message({"acquire", "run", folder / "rig.toml"}), HasSubstr("no such camera"));
  // All keys that are commented out are keys of the program; a display belongs to a window alone, a
  // truth to a simulated rig.
  text = std::regex_replace(text, std::regex("\n# (\\[[a-z]+\\]|[a-z_]+ = )"), "\n$1");
  text = std::regex_replace(text, std::regex("\n(display|truth) = [^\n]*"), "");
  write_text_atomically(folder / "all.toml", text);
  EXPECT_THAT(message({"acquire", "run", folder / "all.toml"}), HasSubstr("no such camera"));
  EXPECT_THAT(
      text, AllOf(HasSubstr("\nstrobe_active_low = "), HasSubstr("\n[trigger]"), HasSubstr("\npreview = ")));
}

}  // namespace
}  // namespace refield
