// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <string>

#include "core/image/image_io.h"
#include "tests/studies/run_studies.h"
#include "tests/support/random_data.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

using test::draws;
using test::run_refield;
using test::run_studies;
using test::StudyRefusedNaming;
using test::Succeeded;

const std::string small_scene = REFIELD_SOURCE_DIR "/datasets_synthetic/prt/small.toml";

std::string environment(const test::TemporaryFolder& folder) {
  Rng rng(1);
  const std::string path = folder / "sky.exr";
  write_exr(path, test::random_image(rng, 32, 16, 3));
  return path;
}

std::string chart_scene(const test::TemporaryFolder& folder) {
  const std::string path = folder / "scene.toml";
  std::ofstream(path) << "[[object]]\nshape = 'rabbit'\nresolution = 5\non_ground = true\n"
                         "[[object]]\nshape = 'plane'\nresolution = 12\nsize = 3.0\n";
  return path;
}

/// The last column of each row of a chart: the error under the last map.
std::vector<double> last_errors(const std::string& path) {
  std::ifstream csv(path);
  std::string line;
  std::getline(csv, line);
  EXPECT_EQ(
      line,
      "method,setting,kernels,weights_per_vertex,megabytes,precompute_seconds,relight_ms,two_area_lights_ms,"
      "median_error,sky");
  std::vector<double> errors;
  while (std::getline(csv, line)) errors.push_back(std::stod(line.substr(line.rfind(',') + 1)));
  return errors;
}

TEST(PrtChartVerb, ComparesMethodsWithTheExactSum) {
  const test::TemporaryFolder folder;
  ASSERT_THAT(run_studies({"prt-chart", chart_scene(folder), environment(folder), "-o", folder / "chart",
                           "--resolution", "16", "--vertices", "64"}),
              Succeeded());
  const std::vector<double> errors = last_errors(folder / "chart/prt.csv");
  EXPECT_EQ(errors.size(), 28u);
  EXPECT_LT(*std::ranges::min_element(errors), 0.02);
  draws(folder / "chart", {"prt.svg"});
}

TEST(PrtChartVerb, ComparesFieldsThatAreThere) {
  const test::TemporaryFolder folder;
  const std::string scene = chart_scene(folder), coarse = folder / "coarse.rfield",
                    fine = folder / "fine.rfield";
  const auto compute = [&](const std::string& field, const char* epsilon) {
    return run_refield(
        {"precompute", scene, "-o", field, "--resolution", "16", "--epsilon", epsilon, "--json"});
  };
  ASSERT_THAT(compute(coarse, "0.02"), Succeeded());
  ASSERT_THAT(compute(fine, "1e-4"), Succeeded());
  std::vector<std::string> command = {"prt-chart",      scene,      "--sky", "0.3", "-o",
                                      folder / "chart", "--fields", coarse,  fine,  "--pictures",
                                      "--resolution",   "16"};
  ASSERT_THAT(run_studies(command), Succeeded());
  const std::vector<double> errors = last_errors(folder / "chart/prt.csv");
  ASSERT_EQ(errors.size(), 2u);
  EXPECT_LT(errors[1], 0.01);
  EXPECT_LT(errors[1], 0.3 * errors[0]);

  // The exact picture and two more, their differences below: none of the first, most of the second.
  const Image sheet = read_image(folder / "chart/pictures.png");
  const auto difference_of = [&](int column) {
    const int width = sheet.width / 3;
    double sum = 0.0;
    for (int y = sheet.height / 2; y < sheet.height; ++y)
      for (int x = column * width; x < (column + 1) * width; ++x) sum += sheet.at(x, y, 0);
    return sum;
  };
  EXPECT_EQ(difference_of(0), 0.0);
  EXPECT_GT(difference_of(1), 2.0 * difference_of(2));
  EXPECT_GT(difference_of(2), 0.0);

  command.back() = "32";
  EXPECT_THAT(run_studies(command), StudyRefusedNaming("coarse.rfield", "--resolution 16"));
  command[1] = small_scene;
  EXPECT_THAT(run_studies(command), StudyRefusedNaming("coarse.rfield", "this scene"));
}

}  // namespace
}  // namespace refield
