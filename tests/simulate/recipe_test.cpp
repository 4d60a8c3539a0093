// SPDX-License-Identifier: Apache-2.0
#include "simulate/tabletop/recipe.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

using testing::AllOf;
using testing::HasSubstr;

const std::string good = R"(seed = 5
[camera]
width = 32
height = 24
position = [0, 0.4, -1.2]
target = [0, 0.1, 0]
[monitor]
width = 64
height = 48
position = [0.6, 0.3, 0.0]
towards = [-0.4, 0.3, 0.0]
latency_ms = 50
[sensor]
layout = "bayer_rggb"
bits = 10
[exposures]
ratio = 3.0
longest_s = 0.5
[[material]]
name = "grey"
kind = "diffuse"
[[object]]
shape = "plane"
material = "grey"
)";

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const auto at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

class RecipeTest : public testing::Test {
 protected:
  Recipe read(const std::string& text) {
    write_text_atomically(path_, text);
    return read_recipe(path_);
  }
  std::string error_of(const std::string& text) {
    try {
      read(text);
    } catch (const InputError& error) {
      return error.what();
    }
    return "no error";
  }
  test::TemporaryFolder folder_;
  std::filesystem::path path_ = folder_ / "recipe.toml";
};

TEST_F(RecipeTest, ReadsValuesAndKeepsDefaults) {
  const Recipe recipe = read(good);
  EXPECT_EQ(recipe.seed, 5u);
  EXPECT_EQ(recipe.scene.camera.width, 32);
  EXPECT_EQ(recipe.scene.monitor.texels, (LightDomain{64, 48, Parameterisation::monitor}));
  EXPECT_DOUBLE_EQ(recipe.rig.monitor.latency.count(), 0.05);
  EXPECT_EQ(recipe.rig.sensor.layout, PixelLayout::bayer_rggb);
  EXPECT_EQ(recipe.rig.sensor.bits, 10);
  EXPECT_EQ(recipe.rig.exposures.count, 4);
  EXPECT_DOUBLE_EQ(recipe.rig.exposures.ratio, 3.0);
  EXPECT_DOUBLE_EQ(recipe.rig.exposures.longest->count(), 0.5);
  EXPECT_EQ(recipe.lights.train, 180);
  EXPECT_EQ(recipe.scene.objects.at(0).material, "grey");
}

TEST_F(RecipeTest, ScenesAreMirroredIntoRightHandedAxes) {
  const Recipe recipe = read(good + "position = [1, 2, 3]\nrotation = [30, 20, 10]\n");
  EXPECT_EQ(recipe.scene.camera.position, Eigen::Vector3d(0, 0.4, 1.2));
  EXPECT_EQ(recipe.scene.monitor.centre, Eigen::Vector3d(0.6, 0.3, 0.0));
  EXPECT_LT((recipe.scene.monitor.facing - Eigen::Vector3d(-1, 0, 0)).norm(), 1e-12);
  const prt::Placement& place = recipe.scene.objects.at(0).place;
  EXPECT_EQ(*place.position, Eigen::Vector3f(1, 2, -3));
  const Eigen::Vector3d flip(1, 1, -1);
  const Eigen::Matrix3d turn = rotation_of(EulerAngles{.yaw = 30, .pitch = 20, .roll = 10});
  EXPECT_LT((rotation_of(place.turn) - flip.asDiagonal() * turn * flip.asDiagonal()).norm(), 1e-12);
}

TEST_F(RecipeTest, ErrorsNameFileLineKeyValueAndRemedy) {
  EXPECT_THAT(error_of(replaced(good, "width = 32", "width = -32")),
              AllOf(HasSubstr("recipe.toml:3:"), HasSubstr("[camera] width = -32"), HasSubstr("from 1 to")));
  EXPECT_THAT(error_of(replaced(good, "bits = 10", "bits = 9")),
              AllOf(HasSubstr(":15:"), HasSubstr("8, 10 or 12")));
  EXPECT_THAT(error_of(replaced(good, "\"diffuse\"", "\"velvet\"")),
              AllOf(HasSubstr(":21:"), HasSubstr("velvet"), HasSubstr("translucent")));
  EXPECT_THAT(error_of(replaced(good, "material = \"grey\"", "material = \"gray\"")),
              AllOf(HasSubstr("gray"), HasSubstr("there are grey")));
  EXPECT_THAT(error_of(replaced(good, "[0, 0.4, -1.2]", "[0, 0.4]")), HasSubstr("three numbers"));
  EXPECT_THAT(error_of(replaced(good, "ratio = 3.0", "ratio = nan")), HasSubstr("ratio"));
}

TEST_F(RecipeTest, UnknownKeysAreErrors) {
  EXPECT_THAT(error_of(replaced(good, "latency_ms = 50", "latncy_ms = 50")),
              AllOf(HasSubstr(":12:"), HasSubstr("latncy_ms"), HasSubstr("latency_ms")));
  EXPECT_THAT(error_of(good + "[camra]\n"), HasSubstr("camra"));
  EXPECT_THAT(error_of(replaced(good, "\"plane\"", "\"sphere\"") + "radius = 0.1\n"),
              AllOf(HasSubstr("radius"), HasSubstr("size")));
  EXPECT_THAT(error_of(replaced(good, "\"plane\"", "\"sphere\"") + "stretch = [1, 2, 1]\n"),
              HasSubstr("give its diameter as `size`"));
  EXPECT_THAT(error_of(replaced(good, "kind = \"diffuse\"", "roughness = 0.3")),
              HasSubstr("the following kinds do: glossy, metal"));
}

TEST_F(RecipeTest, TakesWhatItLacksFromItsBase) {
  write_text_atomically(folder_ / "base.toml", good);
  const Recipe recipe = read(R"(base = "base.toml"
[camera]
height = 20
moves = [[0.25, 0.5, 0.0], [0.5, 0.5, -0.25]]
[ambient]
switched = [[0.5, 3.0]]
[sensor]
bits = 12
)");
  EXPECT_EQ(recipe.seed, 5u);
  EXPECT_EQ(recipe.scene.camera.width, 32);
  EXPECT_EQ(recipe.scene.camera.height, 20);
  EXPECT_EQ(recipe.rig.sensor.bits, 12);
  EXPECT_EQ(recipe.rig.sensor.layout, PixelLayout::bayer_rggb);
  EXPECT_EQ(recipe.scene.objects.size(), 1u);
  const Disturbances& disturbances = recipe.rig.disturbances;
  EXPECT_EQ(disturbances.position(0.2).right_px, 0.0);
  EXPECT_EQ(disturbances.position(0.25).right_px, 0.5);
  EXPECT_EQ(disturbances.position(1.0).down_px, -0.25);
  EXPECT_EQ(disturbances.room(0.6), 3.0);
}

TEST_F(RecipeTest, ErrorsOfABaseNameItsFile) {
  write_text_atomically(folder_ / "base.toml", replaced(good, "width = 32", "width = -32"));
  EXPECT_THAT(error_of("base = \"base.toml\"\n"),
              AllOf(HasSubstr("base.toml:3:"), HasSubstr("[camera] width = -32")));
  EXPECT_THAT(error_of("base = \"none.toml\"\n"), HasSubstr("none.toml: there is no such recipe"));
  write_text_atomically(folder_ / "base.toml", "base = \"recipe.toml\"\n");
  EXPECT_THAT(error_of("base = \"base.toml\"\n"), HasSubstr("'base' is not a known key"));
}

TEST_F(RecipeTest, MovesAscendWithTheCapture) {
  for (const char* moves : {"[[0.5, 1.0]]", "[[0.5, 1.0, 0.0], [0.4, 0.0, 0.0]]", "[[1.5, 1.0, 0.0]]", "3"})
    EXPECT_THAT(error_of(replaced(good, "width = 32", std::string("moves = ") + moves + "\nwidth = 32")),
                HasSubstr("give rows [share of the capture, pixels to the right, pixels down]"));
}

TEST_F(RecipeTest, MissingPartsAreErrors) {
  EXPECT_THAT(error_of(replaced(good, "target = [0, 0.1, 0]\n", "")),
              AllOf(HasSubstr("target"), HasSubstr("missing")));
  EXPECT_THAT(error_of("seed = 1\n"), HasSubstr("[camera]"));
  EXPECT_THAT(error_of("not toml"), HasSubstr("recipe.toml:1:"));
  EXPECT_THROW(read_recipe(folder_ / "none.toml"), InputError);
}

TEST_F(RecipeTest, ScenesThatCannotBeLookedAtAreErrors) {
  EXPECT_THAT(error_of(replaced(good, "target = [0, 0.1, 0]", "target = [0, 0.1, -1.2]")),
              HasSubstr("up direction"));
  EXPECT_THAT(error_of(replaced(good, "towards = [-0.4, 0.3, 0.0]", "towards = [0.6, 0.5, 0.0]")),
              HasSubstr("flat"));
}

TEST(TabletopRecipe, IsValidAndAsLargeAsTheDemoNeeds) {
  const Recipe recipe =
      read_recipe(std::filesystem::path(REFIELD_SOURCE_DIR) / "datasets_synthetic/tabletop/recipe.toml");
  EXPECT_GE(recipe.scene.camera.width, 160);
  EXPECT_GE(recipe.scene.camera.height, 120);
  EXPECT_GE(recipe.scene.monitor.texels.width, 128);
  EXPECT_GE(recipe.scene.monitor.texels.height, 96);
  EXPECT_EQ(recipe.lights.train, 180);
  EXPECT_EQ(recipe.rig.exposures.count, 4);
}

}  // namespace
}  // namespace refield
