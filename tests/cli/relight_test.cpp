// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>

#include "core/base/files.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/image_io.h"
#include "tests/cli/matchers.h"
#include "tests/support/random_data.h"
#include "tests/support/small_disk.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

namespace fs = std::filesystem;
using test::RefusedNaming;
using test::run_refield;
using test::Succeeded;

constexpr LightDomain domain{16, 8, Parameterisation::lat_long};

class RelightVerb : public testing::Test {
 protected:
  RelightVerb() {
    write_reflectance_field(field_, test::random_field(rng_, 12, 9, domain, 40, 6));
    write_exr(light_, test::random_light(rng_, domain).radiance);
  }

  test::CommandResult relight(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), {"relight", field_});
    return run_refield(arguments);
  }

  test::TemporaryFolder folder_;
  Rng rng_{1};
  const std::string field_ = folder_ / "scene.rfield";
  const std::string light_ = folder_ / "light.exr";
  const std::string output_ = folder_ / "out.exr";
};

TEST_F(RelightVerb, OneLight) {
  EXPECT_THAT(relight({"--light", light_, "-o", output_}), Succeeded());
  const Image expected =
      read_reflectance_field(field_).relight(read_light_map(light_, Parameterisation::lat_long));
  EXPECT_EQ(read_image(output_).values, expected.values);
}

TEST_F(RelightVerb, PngIsChosenByTheExtension) {
  EXPECT_THAT(relight({"--light", light_, "-o", folder_ / "out.png", "--exposure", "0.5"}), Succeeded());
  EXPECT_EQ(read_image_header(folder_ / "out.png").width, 12);
}

TEST_F(RelightVerb, TheDefaultExposureIsPrintedAndRepeatsThePicture) {
  const auto result = relight({"--light", light_, "-o", folder_ / "auto.png"});
  EXPECT_THAT(result, Succeeded());
  const auto at = result.out.find("--exposure ");
  ASSERT_NE(at, std::string::npos) << result.out;
  const std::string factor = result.out.substr(at + 11, result.out.find_first_of(" )\n", at + 11) - at - 11);
  const auto again =
      relight({"--light", light_, "-o", folder_ / "again.png", "--exposure", factor, "--json"});
  EXPECT_THAT(again, Succeeded());
  EXPECT_EQ(read_text(folder_ / "again.png"), read_text(folder_ / "auto.png"));
  EXPECT_EQ(nlohmann::json::parse(again.out)["exposures"][0].get<double>(), std::stod(factor));
  EXPECT_EQ(again.err.find("clipped"), std::string::npos);

  const auto clipped =
      relight({"--light", light_, "-o", folder_ / "white.png", "--exposure", "1e6", "--quiet"});
  EXPECT_THAT(clipped, Succeeded());
  EXPECT_NE(clipped.err.find("are clipped"), std::string::npos) << clipped.err;
  const auto none = relight({"--light", light_, "-o", output_, "--exposure", "1e6", "--quiet"});
  EXPECT_EQ(none.err, "") << "EXR files are not exposed";
}

TEST_F(RelightVerb, NumbersThatAreNoneAreRefused) {
  EXPECT_THAT(relight({"--yaw", "1e30", "--env", light_, "-o", folder_ / "a.png"}),
              RefusedNaming("yaw", "from -1e6 to 1e6"));
  for (const std::vector<std::string>& arguments : {std::vector<std::string>{"--yaw", "nan"},
                                                    {"--pitch", "inf"},
                                                    {"--latitude", "NaN"},
                                                    {"--fps", "nan"},
                                                    {"--exposure", "nan"},
                                                    {"--exposure", "0"},
                                                    {"--exposure", "bright"}}) {
    auto all = arguments;
    all.insert(all.end(), {"--env", light_, "-o", folder_ / "a.png"});
    const auto result = relight(all);
    EXPECT_EQ(result.status, 2) << testing::PrintToString(arguments);
    EXPECT_NE(result.err.find(arguments[0] + ": is '" + arguments[1] + "'; give a"), std::string::npos)
        << result.err;
    EXPECT_LT(result.err.size(), 200u) << result.err;
    EXPECT_FALSE(fs::exists(folder_ / "a.png"));
  }
}

TEST_F(RelightVerb, AFolderIsNotNamedLikeAnImage) {
  for (const char* name : {"x.exr", "x.PNG", "x.mov"}) {
    EXPECT_THAT(relight({"--light", light_, "--rotate", "--frames", "2", "-o", folder_ / name}),
                RefusedNaming(name, "folder"));
    EXPECT_FALSE(fs::exists(folder_ / name));
  }
}

TEST_F(RelightVerb, SeveralLightsGoToAFolder) {
  fs::create_directory(folder_ / "lights");
  for (const char* name : {"a.exr", "b.exr"}) fs::copy_file(light_, folder_ / "lights" / name);
  const std::string pattern = folder_ / "lights/*.exr";
  EXPECT_THAT(relight({"--light", pattern, "-o", folder_ / "by_pattern"}), Succeeded());
  EXPECT_THAT(relight({"--light", folder_ / "lights", "-o", folder_ / "by_folder"}), Succeeded());
  EXPECT_THAT(relight({"--light", folder_ / "lights/a.exr", "--light", folder_ / "lights/b.exr", "-o",
                       folder_ / "by_name", "--format", "png"}),
              Succeeded());
  for (const char* file : {"by_pattern/a.exr", "by_pattern/b.exr", "by_folder/b.exr", "by_name/a.png"})
    EXPECT_TRUE(fs::exists(folder_ / file)) << file;
}

TEST_F(RelightVerb, SequencesOfABarAndOfARotation) {
  const auto result = relight({"--bar", "0.125", "--frames", "3", "-o", folder_ / "bar", "--json"});
  EXPECT_THAT(result, Succeeded());
  EXPECT_EQ(nlohmann::json::parse(result.out)["images"].size(), 3u);
  EXPECT_TRUE(fs::exists(folder_ / "bar/bar_0002.exr"));
  EXPECT_THAT(relight({"--light", light_, "--rotate", "--frames", "2", "-o", folder_ / "turn"}), Succeeded());
  EXPECT_THAT(relight({"--light", light_, "-o", output_}), Succeeded());
  EXPECT_EQ(read_image(folder_ / "turn/rotation_0000.exr").values, read_image(output_).values);
}

TEST_F(RelightVerb, EnvironmentsOfAnySize) {
  write_exr(folder_ / "large.exr", Image(64, 32, 3, 1.0f));
  write_exr(folder_ / "cube.exr", Image(5, 30, 3, 1.0f));
  write_exr(folder_ / "own.exr", Image(16, 8, 3, 1.0f));
  EXPECT_THAT(relight({"--light", folder_ / "own.exr", "-o", output_}), Succeeded());
  for (const char* map : {"large.exr", "cube.exr"}) {
    EXPECT_THAT(relight({"--env", folder_ / map, "--pitch", "30", "-o", folder_ / "env.exr"}), Succeeded());
    const Image found = read_image(folder_ / "env.exr"), expected = read_image(output_);
    for (std::size_t i = 0; i < found.values.size(); ++i)
      ASSERT_NEAR(found.values[i], expected.values[i], 1e-5 * (1.0 + expected.values[i])) << map;
  }
  EXPECT_THAT(relight({"--env", light_, "--rotate", "--frames", "2", "-o", folder_ / "turn"}), Succeeded());
  EXPECT_THAT(relight({"--light", light_, "-o", output_}), Succeeded());
  EXPECT_EQ(read_image(folder_ / "turn/rotation_0000.exr").values, read_image(output_).values);
}

TEST_F(RelightVerb, AnEnvironmentNeedsToKnowWhereTheMonitorStood) {
  ReflectanceField field = test::random_field(rng_, 12, 9, {16, 8, Parameterisation::monitor}, 40, 6);
  const std::string window = folder_ / "window.rfield";
  write_reflectance_field(window, field);
  const auto relit = [&](std::vector<std::string> more) {
    more.insert(more.begin(), {"relight", window, "--env", light_, "-o", output_});
    return run_refield(more);
  };
  EXPECT_THAT(relit({}), RefusedNaming("window.rfield", "--placement 520x320@600"));
  EXPECT_THAT(relit({"--placement", "520x320"}), RefusedNaming("520x320", "distance"));
  const auto result = relit({"--placement", "520x320@300,yaw=90", "--json"});
  EXPECT_THAT(result, Succeeded());
  const Image by_option = read_image(output_);
  field.monitors = {{520, 320, 300, {90, 0, 0}}};
  write_reflectance_field(window, field);
  EXPECT_THAT(relit({}), Succeeded());
  EXPECT_EQ(read_image(output_).values, by_option.values);
  // Its half-angles are atan(260/300) and atan(160/300).
  const auto seen = nlohmann::json::parse(result.out)["seen_by_monitor"][0];
  EXPECT_NEAR(seen["share_of_directions"].get<double>(), 0.09973, 1e-5);
  EXPECT_GT(seen["share_of_light"].get<double>(), 0.0);
}

TEST_F(RelightVerb, DaysAndFades) {
  EXPECT_THAT(relight({"--day", "--frames", "3", "-o", folder_ / "day"}), Succeeded());
  const auto brightness = [&](const std::string& name) {
    const Image image = read_image(folder_ / name);
    return *std::ranges::max_element(image.values);
  };
  EXPECT_GT(brightness("day/day_0001.exr"), 5.0f * brightness("day/day_0000.exr"));

  write_exr(folder_ / "other.exr", test::random_light(rng_, {40, 20, Parameterisation::lat_long}).radiance);
  EXPECT_THAT(relight({"--env", light_, folder_ / "other.exr", "--frames", "3", "-o", folder_ / "fade"}),
              Succeeded());
  EXPECT_THAT(relight({"--env", light_, "--env", folder_ / "other.exr", "-o", folder_ / "ends"}),
              Succeeded());
  const Image first = read_image(folder_ / "ends/light.exr"), last = read_image(folder_ / "ends/other.exr");
  const Image middle = read_image(folder_ / "fade/fade_0001.exr");
  EXPECT_EQ(read_image(folder_ / "fade/fade_0002.exr").values, last.values);
  for (std::size_t i = 0; i < middle.values.size(); ++i)
    ASSERT_NEAR(middle.values[i], 0.5f * (first.values[i] + last.values[i]),
                1e-4f * (1.0f + middle.values[i]));
}

TEST_F(RelightVerb, AVideoIsChosenByTheExtension) {
  const std::string video = folder_ / "bar.mp4";
  const auto result = relight({"--bar", "0.2", "--frames", "5", "--fps", "10", "--json", "-o", video});
  if (result.status != 0 && result.err.find("apt-get install ffmpeg") != std::string::npos)
    GTEST_SKIP() << "ffmpeg is not installed";
  EXPECT_THAT(result, Succeeded());
  EXPECT_EQ(nlohmann::json::parse(result.out)["videos"][0], video);
  EXPECT_EQ(read_text(video).substr(4, 4), "ftyp");
}

TEST_F(RelightVerb, ALightOfTheWrongSize) {
  std::ofstream(output_) << "old";
  write_exr(folder_ / "wide.exr", Image(17, 8, 3, 1.0f));
  EXPECT_THAT(relight({"--light", folder_ / "wide.exr", "-o", output_}), RefusedNaming("wide.exr", "16×8"));
  EXPECT_EQ(read_text(output_), "old");
}

TEST_F(RelightVerb, ATruncatedOrNotFiniteLight) {
  std::ofstream(output_) << "old";
  const std::string bytes = read_text(light_);
  std::ofstream(folder_ / "cut.exr") << bytes.substr(0, bytes.size() / 2);
  EXPECT_THAT(relight({"--light", folder_ / "cut.exr", "-o", output_}),
              RefusedNaming("cut.exr", "truncated"));
  Image broken = test::random_light(rng_, domain).radiance;
  broken.at(3, 2, 1) = NAN;
  write_exr(folder_ / "nan.exr", broken);
  EXPECT_THAT(relight({"--light", folder_ / "nan.exr", "-o", output_}), RefusedNaming("nan.exr", "(3, 2)"));
  EXPECT_EQ(read_text(output_), "old");
}

TEST_F(RelightVerb, AFileThatIsNoField) {
  std::ofstream(folder_ / "text.rfield") << "these are just words";
  EXPECT_THAT(run_refield({"relight", folder_ / "text.rfield", "--light", light_, "-o", output_}),
              RefusedNaming("text.rfield", "refield estimate"));
  EXPECT_THAT(run_refield({"relight", folder_ / "none.rfield", "--light", light_, "-o", output_}),
              RefusedNaming("none.rfield", "No such file"));
  EXPECT_FALSE(fs::exists(output_));
}

TEST_F(RelightVerb, NeverWritesOverItsInputs) {
  const std::string before = read_text(light_);
  EXPECT_THAT(relight({"--light", light_, "-o", light_}), RefusedNaming("light.exr", "another output"));
  EXPECT_THAT(relight({"--light", light_, "-o", folder_.path()}),
              RefusedNaming("light.exr", "another output"));
  EXPECT_EQ(read_text(light_), before);
}

TEST_F(RelightVerb, OptionsThatDoNotFitTogether) {
  const auto out = std::string(folder_ / "o");
  for (const std::vector<std::string>& arguments :
       {std::vector<std::string>{"-o", out},
        {"--bar", "0.1", "-o", out},
        {"--bar", "2", "--frames", "3", "-o", out},
        {"--light", light_, "--bar", "0.1", "--frames", "2", "-o", out},
        {"--light", light_, "--frames", "2", "-o", out},
        {"--light", light_, "--env", light_, "-o", out},
        {"--light", light_, "--yaw", "10", "-o", out},
        {"--env", light_, "--frames", "2", "-o", out},
        {"--env", light_, "--placement", "520x320@600", "-o", out},
        {"--env", light_, "-o", out + ".jpg"},
        {"--day", "-o", out},
        {"--day", "--frames", "2", "--latitude", "100", "-o", out},
        {"--bar", "0.1", "--frames", "2", "--fps", "0", "-o", out},
        {"--light", light_, "-o", out + ".jpg"},
        {"--light", folder_ / "*.png", "-o", out},
        {"--light", light_}}) {
    const auto result = relight(arguments);
    EXPECT_EQ(result.status, 2) << testing::PrintToString(arguments);
    EXPECT_FALSE(result.err.empty());
  }
}

TEST_F(RelightVerb, AFullDisk) {
  const test::SmallDisk disk(64);
  if (!disk.mounted()) GTEST_SKIP() << test::needs_mounting;
  write_reflectance_field(field_, test::random_field(rng_, 200, 200, domain, 40, 6));
  write_exr(disk / "out.exr", Image(2, 2, 3, 1.0f));
  const std::string old = read_text(disk / "out.exr");
  EXPECT_THAT(relight({"--light", light_, "-o", disk / "out.exr"}),
              RefusedNaming("out.exr", "free some space"));
  EXPECT_EQ(read_text(disk / "out.exr"), old);
}

}  // namespace
}  // namespace refield
