// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "core/image/image_io.h"
#include "tests/cli/matchers.h"
#include "tests/support/random_data.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

using nlohmann::json;
using test::RefusedNaming;
using test::run_refield;
using test::Succeeded;

const std::string small_scene = REFIELD_SOURCE_DIR "/datasets_synthetic/prt/small.toml";

std::string environment(const test::TemporaryFolder& folder) {
  Rng rng(1);
  const std::string path = folder / "sky.exr";
  write_exr(path, test::random_image(rng, 32, 16, 3));
  return path;
}

struct Method {
  const char* name;
  std::vector<std::string> options;
};
void PrintTo(const Method& method, std::ostream* stream) {
  *stream << method.name;
}

class SimulatePrtVerb : public testing::TestWithParam<Method> {};
INSTANTIATE_TEST_SUITE_P(
    Methods, SimulatePrtVerb,
    testing::Values(Method{"clusters", {"--resolution", "32", "--epsilon", "2e-3"}},
                    Method{"clusters", {"--resolution", "16", "--mode", "paper", "--epsilon", "1e-3"}},
                    Method{"sh", {"--sh-order", "3", "--directions", "128"}}));

TEST_P(SimulatePrtVerb, MakesAFieldForTheSameRelighter) {
  const test::TemporaryFolder folder;
  const std::string field = folder / "f.rfield", picture = folder / "picture.exr";
  std::vector<std::string> command = {"precompute", small_scene,     "-o",    field,
                                      "--method",   GetParam().name, "--json"};
  command.insert(command.end(), GetParam().options.begin(), GetParam().options.end());
  const auto result = run_refield(command);
  ASSERT_THAT(result, Succeeded());
  const json figures = json::parse(result.out);
  EXPECT_EQ(figures["bytes"], std::filesystem::file_size(field));

  const json info = json::parse(run_refield({"info", field, "--json"}).out);
  EXPECT_EQ(info["kind"], "precomputed reflectance field");
  EXPECT_EQ(info["mesh"]["vertices"], figures["vertices"]);
  EXPECT_EQ(info["basis"]["sums"], "radiance times solid angle");
  EXPECT_EQ(info["provenance"]["method"], GetParam().name);

  ASSERT_THAT(run_refield({"relight", field, "--env", environment(folder), "-o", picture}), Succeeded());
  double sum = 0.0;
  for (const float value : read_image(picture).values) sum += value;
  EXPECT_GT(sum, 0.0);
  EXPECT_TRUE(std::isfinite(sum));
}

TEST(SimulatePrtVerb, AddsReflectedLight) {
  const test::TemporaryFolder folder;
  const std::string sky = environment(folder);
  const auto brightness = [&](const char* bounces) {
    const std::string field = folder / "f.rfield", picture = folder / "picture.exr";
    EXPECT_THAT(run_refield({"precompute", small_scene, "-o", field, "--resolution", "16", "--epsilon",
                             "2e-3", "--diffuse-bounces", bounces}),
                Succeeded());
    EXPECT_EQ(json::parse(run_refield({"info", field, "--json"}).out)["provenance"]["bounces"],
              std::stoi(bounces));
    EXPECT_THAT(run_refield({"relight", field, "--env", sky, "-o", picture}), Succeeded());
    double sum = 0.0;
    for (const float value : read_image(picture).values) sum += value;
    return sum;
  };
  const double none = brightness("0"), one = brightness("1"), two = brightness("2");
  EXPECT_GT(one, 1.01 * none);
  EXPECT_GT(two, one);
  EXPECT_LT(two - one, one - none);
}

TEST(RelightVerbOnMeshes, ShowsPaintedLightsThatMoveAroundThem) {
  const test::TemporaryFolder folder;
  const std::string field = folder / "f.rfield", out = folder / "out";
  ASSERT_THAT(run_refield({"precompute", small_scene, "-o", field, "--method", "sh", "--sh-order", "3",
                           "--directions", "64", "--radius", "4"}),
              Succeeded());
  // From the left to the right.
  std::ofstream(folder / "lights.toml") << "[[light]]\nshape = 'sphere'\nsize = 1.5\nradiance = [5, 5, 5]\n"
                                           "path = [[0, -3, 1.5, -1], [2, 3, 1.5, -1]]\n";
  ASSERT_THAT(
      run_refield({"relight", field, "--area-lights", folder / "lights.toml", "--frames", "2", "-o", out}),
      Succeeded());
  const auto left_share = [&](const char* name) {
    const Image image = read_image(std::filesystem::path(out) / name);
    double left = 0.0, all = 0.0;
    for (int y = 0; y < image.height; ++y)
      for (int x = 0; x < image.width; ++x) {
        all += image.at(x, y, 0);
        if (x < image.width / 2) left += image.at(x, y, 0);
      }
    return left / all;
  };
  EXPECT_GT(left_share("area_lights_0000.exr"), left_share("area_lights_0001.exr") + 0.05);
  EXPECT_THAT(run_refield({"relight", field, "--area-lights", folder / "lights.toml", "-o", out}),
              RefusedNaming("--area-lights", "--frames"));
}

TEST(SimulatePrtVerbErrors, NameTheRemedy) {
  const test::TemporaryFolder folder;
  EXPECT_THAT(run_refield({"precompute", folder / "none.ply", "-o", folder / "f.rfield"}),
              RefusedNaming("none.ply", "No such file"));
  EXPECT_THAT(
      run_refield({"precompute", small_scene, "-o", folder / "f.rfield", "--method", "sh", "--image"}),
      RefusedNaming("--image", "--method clusters"));
  EXPECT_THAT(run_refield({"precompute", small_scene, "-o", folder / "f.rfield", "--method", "sh", "--mode",
                           "paper"}),
              RefusedNaming("--mode", "--method clusters"));
  EXPECT_THAT(run_refield({"precompute", small_scene, "-o", folder / "f.rfield", "--sh-order", "3"}),
              RefusedNaming("--sh-order", "--method sh"));
  const auto without_image =
      run_refield({"precompute", small_scene, "-o", folder / "f.rfield", "--pixel-samples", "2"});
  EXPECT_EQ(without_image.status, 2);
  EXPECT_NE(without_image.err.find("--pixel-samples requires --image"), std::string::npos)
      << without_image.err;
}

}  // namespace
}  // namespace refield
