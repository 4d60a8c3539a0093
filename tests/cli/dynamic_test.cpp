// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "core/base/files.h"
#include "core/image/image_io.h"
#include "tests/cli/matchers.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

using nlohmann::json;
using test::RefusedNaming;
using test::run_refield;
using test::Succeeded;

const char* const moving_ball = REFIELD_SOURCE_DIR "/tests/support/moving_ball.toml";

class SimulateDynamicVerb : public testing::Test {
 protected:
  std::string scene(const std::string& text) {
    const std::string path = folder_ / "scene.toml";
    std::ofstream(path) << text;
    return path;
  }
  std::vector<std::string> command(std::vector<std::string> more) {
    std::vector<std::string> all = {"render", moving_ball};
    all.insert(all.end(), more.begin(), more.end());
    return all;
  }
  test::TemporaryFolder folder_;
};

TEST_F(SimulateDynamicVerb, TellsWhatItPrecomputed) {
  const auto result = run_refield(command({"--json"}));
  ASSERT_THAT(result, Succeeded());
  const json figures = json::parse(result.out);
  EXPECT_EQ(figures["objects"].size(), 2u);
  EXPECT_EQ(figures["objects"][0]["name"], "ball");
  EXPECT_EQ(figures["objects"][1]["terms"], 1);
}

TEST_F(SimulateDynamicVerb, WritesOnePictureAFolderAndAFilm) {
  ASSERT_THAT(run_refield(command({"-o", folder_ / "one.exr"})), Succeeded());
  EXPECT_GT(read_image(folder_ / "one.exr").at(32, 40, 0), 0.01f);
  ASSERT_THAT(run_refield(command({"-o", folder_ / "frames", "--fps", "10"})), Succeeded());
  const auto brightest = [&](const std::string& name) {
    const Image image = read_image(folder_ / name);
    return *std::ranges::max_element(image.values);
  };
  EXPECT_GT(brightest("frames/frame_00001.png"), 0.9f);
  const auto result = run_refield(command({"-o", folder_ / "one.png", "--json"}));
  ASSERT_THAT(result, Succeeded());
  EXPECT_GT(json::parse(result.out)["exposure"].get<double>(), 0.0);
  for (const char* name : {"frame_00000.png", "frame_00002.png"})
    EXPECT_TRUE(std::filesystem::exists(folder_ / (std::string("frames/") + name))) << name;
  EXPECT_FALSE(std::filesystem::exists(folder_ / "frames/frame_00003.png"));
  ASSERT_THAT(run_refield(command({"-o", folder_ / "film.mp4", "--fps", "10"})), Succeeded());
  // The film's frames are the folder's pictures, but for what H.264 loses.
  constexpr double coding_loss = 0.02;
  const std::string film = folder_ / "film.mp4", back = folder_ / "back_%d.png";
  ASSERT_EQ(std::system(("ffmpeg -v error -i '" + film + "' '" + back + "'").c_str()), 0);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "back_4.png"));
  for (const int i : {0, 1, 2}) {
    const Image picture = read_image(folder_ / ("frames/frame_0000" + std::to_string(i) + ".png"));
    const Image frame = read_image(folder_ / ("back_" + std::to_string(i + 1) + ".png"));
    ASSERT_EQ(frame.values.size(), picture.values.size());
    double difference = 0.0;
    for (std::size_t k = 0; k < frame.values.size(); ++k)
      difference += std::abs(frame.values[k] - picture.values[k]);
    EXPECT_LT(difference / static_cast<double>(frame.values.size()), coding_loss) << "frame " << i;
  }
}

TEST_F(SimulateDynamicVerb, RefusesATimeOrAnExposureThatIsNoNumber) {
  for (const char* option : {"--time", "--exposure", "--fps"}) {
    const auto result = run_refield(command({"-o", folder_ / "one.png", option, "nan"}));
    EXPECT_EQ(result.status, 2);
    EXPECT_NE(result.err.find(std::string(option) + ": is 'nan'; give a"), std::string::npos) << result.err;
  }
}

TEST_F(SimulateDynamicVerb, EqualInputsGiveEqualPictures) {
  ASSERT_THAT(run_refield(command({"-o", folder_ / "a.exr"})), Succeeded());
  ASSERT_THAT(run_refield(command({"-o", folder_ / "b.exr"})), Succeeded());
  EXPECT_EQ(read_image(folder_ / "a.exr").values, read_image(folder_ / "b.exr").values);
}

TEST_F(SimulateDynamicVerb, PaperModeHasSeparateWeightsAndBlurredShadows) {
  // A wide lobe: four terms instead of eleven, a quarter of the paper's precomputation.
  std::string wide = read_text(moving_ball);
  wide.replace(wide.find("exponent = 8"), 12, "exponent = 2");
  const std::string ball = scene(wide);
  const auto objects = [&](const std::string& mode) {
    const auto result =
        run_refield({"render", ball, "-o", folder_ / (mode + ".exr"), "--mode", mode, "--json"});
    EXPECT_THAT(result, Succeeded());
    return json::parse(result.out)["objects"];
  };
  const json refined = objects("refined"), paper = objects("paper");
  EXPECT_EQ(refined[0]["modes"], 0);
  EXPECT_EQ(refined[0]["bytes"], 0);
  EXPECT_EQ(paper[0]["terms"], 4);
  EXPECT_EQ(paper[0]["modes"], 32 * 4);
  EXPECT_THAT(run_refield(command({"--rays", "6", "--mode", "paper"})),
              RefusedNaming("--rays", "--mode paper"));
  const auto ours = read_image(folder_ / "refined.exr").values,
             theirs = read_image(folder_ / "paper.exr").values;
  ASSERT_EQ(ours.size(), theirs.size());
  double difference = 0.0, all = 0.0;
  for (std::size_t i = 0; i < ours.size(); ++i) {
    difference += (theirs[i] - ours[i]) * (theirs[i] - ours[i]);
    all += ours[i] * ours[i];
  }
  // Four bands of harmonics and a small ball: products of harmonics blur its shadow. Measured: 0.12.
  EXPECT_GT(std::sqrt(difference / all), 0.05);
  EXPECT_LT(std::sqrt(difference / all), 0.25);
}

TEST_F(SimulateDynamicVerb, NamesWhatIsWrong) {
  const auto refused = [&](const std::string& text, const std::string& name) {
    EXPECT_THAT(run_refield({"render", scene(text)}), RefusedNaming("scene.toml", name)) << text;
  };
  refused("", "object");
  const std::string whole = read_text(moving_ball);
  refused(whole.substr(0, whole.find("[[light]]")), "light");
  refused("[[object]]\nshape = \"sphere\"\nspecular = [0.5, 0.5, 0.5]\n", "[[material]]");
  const std::string any = "[[object]]\nshape = \"sphere\"\n[[material]]\nname = \"it\"\n";
  refused(any + "exponent = 3\n", "the following kinds do: phong");
  refused(any + "kind = \"phong\"\nexponent = 3\n", "specular");
  refused(any + "kind = \"glass\"\n", "diffuse, phong, ggx");
  refused(any + "kind = \"ggx\"\nspecular = [0, 0, 0]\nroughness = 0.3\n", "kind = \"diffuse\"");
  refused("[[object]]\nshape = \"sphere\"\npath = [[1, 0, 0, 0], [0, 0, 0, 0]]\n", "path");
  refused("[[object]]\nshape = \"sphere\"\nturns = []\n", "turns");
  EXPECT_THAT(run_refield(command({"-o", folder_ / "picture.tiff"})), RefusedNaming("picture.tiff", ".exr"));
}

}  // namespace
}  // namespace refield
