// SPDX-License-Identifier: Apache-2.0
// `refield-studies chart` from end to end, on a scene small enough for a test.
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "core/base/files.h"
#include "tests/pipeline/tiny_recipe.h"
#include "tests/studies/run_studies.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

namespace fs = std::filesystem;
using test::draws;
using test::run_refield;
using test::run_studies;
using test::StudyRefusedNaming;
using test::Succeeded;

std::size_t lines_of(const fs::path& path) {
  const std::string text = read_text(path);
  return static_cast<std::size_t>(std::ranges::count(text, '\n'));
}

class ChartVerb : public testing::Test {
 protected:
  ChartVerb() {
    std::ofstream(folder_ / "recipe.toml") << test::tiny_recipe;
    const auto simulated = run_refield({"simulate", folder_ / "recipe.toml", "-o", truth_, "--train", "30",
                                        "--quality", "1", "--noise", "0.005", "--quiet"});
    EXPECT_THAT(simulated, Succeeded());
  }

  test::CommandResult chart(const std::vector<std::string>& more) {
    std::vector<std::string> arguments = {"chart", truth_, "-o", output_, "--quiet"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return run_studies(arguments);
  }

  test::TemporaryFolder folder_;
  const std::string truth_ = folder_ / "truth", output_ = folder_ / "chart";
};

TEST_F(ChartVerb, ChartsEveryMethodAndResumes) {
  const auto result = chart({"--truth", truth_, "--images", "12,30", "--max-kernels", "5", "--json"});
  ASSERT_THAT(result, Succeeded());
  const auto json = nlohmann::json::parse(result.out);
  // Two rows each of ours, one each of paper, ridge, svd, smooth, haar, box, cells, at two numbers of images.
  EXPECT_EQ(json["rows"], 18);
  EXPECT_EQ(lines_of(output_ + "/chart.csv"), 19u);
  EXPECT_TRUE(json["left_out"].empty());
  bool any_kind = false;
  for (const auto& verdict : json["verdicts"]) {
    if (verdict["measure"] == "natural") {
      // Any method that learns anything at all is far below the error of a black prediction.
      EXPECT_LT(verdict["error"], 0.3);
      EXPECT_GT(verdict["error"], 0.0);
      EXPECT_GE(verdict["ours"], verdict["error"]);
    }
    any_kind |= verdict["measure"] == "natural_diffuse";
  }
  EXPECT_TRUE(any_kind);
  draws(output_, {"time.svg", "size.svg", "images.svg", "relighting.svg"});

  const std::string csv = read_text(output_ + "/chart.csv");
  const auto resumed = chart({"--truth", truth_, "--images", "12,30", "--max-kernels", "5,8", "--resume",
                              "--methods", "ours,box", "--redo", "box", "--json"});
  ASSERT_THAT(resumed, Succeeded());
  EXPECT_EQ(nlohmann::json::parse(resumed.out)["kept_rows"], 16);
  const std::string more = read_text(output_ + "/chart.csv");
  EXPECT_EQ(lines_of(output_ + "/chart.csv"), 21u);
  std::istringstream before(csv);
  for (std::string line; std::getline(before, line);)
    if (!line.starts_with("box")) {
      EXPECT_NE(more.find(line + "\n"), std::string::npos) << "kept as it was: " << line;
    }
}

TEST_F(ChartVerb, WithoutTruthPhotographsAreTheReferenceAndKindsAreDerived) {
  const auto result = chart({"--methods", "ours,cells", "--max-kernels", "5", "--images", "30", "--json"});
  ASSERT_THAT(result, Succeeded());
  const auto json = nlohmann::json::parse(result.out);
  EXPECT_TRUE(json["left_out"].contains("cells"));
  EXPECT_NE(json["pixel_kinds"].get<std::string>().find("derived"), std::string::npos);
  EXPECT_TRUE(fs::exists(output_ + "/kinds.png"));
  // Other data, the same folder.
  EXPECT_THAT(chart({"--truth", truth_, "--methods", "box", "--resume"}),
              StudyRefusedNaming(output_, "--resume"));
}

TEST_F(ChartVerb, TakesPatterns) {
  const auto result =
      run_studies({"chart", "--light", truth_ + "/illumination/train_*.exr", "--observed",
                   truth_ + "/observed/train_*.exr", "--test-light", truth_ + "/illumination/test_*.exr",
                   "--test-observed", truth_ + "/observed/test_*.exr", "--kinds", folder_ / "recipe.toml",
                   "--methods", "ridge", "--images", "30", "-o", output_, "--json", "--quiet"});
  ASSERT_THAT(result, Succeeded());
  std::set<std::string> measures;
  const auto json = nlohmann::json::parse(result.out);
  for (const auto& verdict : json["verdicts"]) {
    measures.insert(verdict["measure"].get<std::string>());
    EXPECT_TRUE(verdict["ours"].is_null());
  }
  EXPECT_TRUE(measures.contains("natural") && measures.contains("bar") && measures.contains("square"))
      << "kinds of light are seen from the maps";
}

TEST_F(ChartVerb, RefusesWhatItCannotUse) {
  EXPECT_THAT(chart({"--methods", "magic"}), StudyRefusedNaming("magic", "smooth"));
  EXPECT_THAT(chart({"--images", "31"}), StudyRefusedNaming("--images 31", "30"));
  EXPECT_THAT(chart({"--images", "1"}), StudyRefusedNaming("--images 1", "from 2"));
  EXPECT_THAT(chart({"--max-kernels", "0"}), StudyRefusedNaming("--max-kernels 0", "1 to 255"));
  EXPECT_THAT(chart({"--light", "x*.exr"}), StudyRefusedNaming("SESSION", "--test-light"));
  EXPECT_THAT(run_studies({"chart", "--light", truth_ + "/illumination/train_*.exr", "--observed",
                           truth_ + "/observed/train_*.exr", "-o", output_}),
              StudyRefusedNaming("--test-light", "--test-observed"));
}

}  // namespace
}  // namespace refield
