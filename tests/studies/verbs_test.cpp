// SPDX-License-Identifier: Apache-2.0
// The verbs dynamic-bases, dynamic-chart and pack-chart from end to end.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "core/base/files.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/image_io.h"
#include "tests/studies/run_studies.h"
#include "tests/support/random_data.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

using test::draws;
using test::run_studies;
using test::StudyRefusedNaming;
using test::Succeeded;

/// An octahedron: so few vertices that most functions have none of their own.
std::string small_figure(const test::TemporaryFolder& folder) {
  write_text_atomically(folder / "small.off",
                        "OFF\n6 8 0\n1 0 0\n-1 0 0\n0 1 0\n0 -1 0\n0 0 1\n0 0 -1\n"
                        "3 0 2 4\n3 2 1 4\n3 1 3 4\n3 3 0 4\n3 2 0 5\n3 1 2 5\n3 3 1 5\n3 0 3 5\n");
  return folder / "small.off";
}

/// Errors of a surface by "basis N".
std::map<std::string, double> errors_of(const std::string& surface, const std::string& csv) {
  std::map<std::string, double> errors;
  std::istringstream lines(csv);
  std::string line;
  const std::string begin = "\"" + surface + "\",\"";
  while (std::getline(lines, line)) {
    if (!line.starts_with(begin)) continue;
    const std::size_t end = line.find('"', begin.size());
    std::istringstream rest(line.substr(end + 2));
    std::vector<std::string> cells;
    for (std::string cell; std::getline(rest, cell, ',');) cells.push_back(cell);
    errors[line.substr(begin.size(), end - begin.size()) + " " + cells.at(0)] = std::stod(cells.at(3));
  }
  return errors;
}

TEST(DynamicBasesVerb, ChartsBasesAndTerms) {
  const test::TemporaryFolder folder;
  const auto run = [&](const std::string& mesh) {
    return run_studies({"dynamic-bases", "--mesh", mesh, "--terms", "1", "-o", folder / "bases"});
  };
  ASSERT_THAT(run(small_figure(folder)), Succeeded());
  const std::string csv = read_text(folder / "bases/bases.csv");
  EXPECT_TRUE(csv.starts_with("surface,basis,functions,kept,condition,error,inverse_error\n"));
  const auto floor = errors_of("floor", csv), small = errors_of("small", csv);
  for (const char* other : {"harmonics 16", "wavelets 16", "cosines 16"})
    EXPECT_LT(floor.at("principal 16"), floor.at(other));
  EXPECT_LT(small.at("harmonics 64"), 1e-3) << "six functions tell all that six vertices can hold";
  EXPECT_NE(csv.find("inf"), std::string::npos);
  EXPECT_TRUE(
      read_text(folder / "bases/factors.csv").starts_with("exponent,terms,error,area_light_error\n4,1,"));
  for (const char* picture : {"bases/bases-floor.png", "bases/bases-figure.png", "bases/factors.png"})
    EXPECT_GT(read_image(folder / picture).width, 100);
  draws(folder / "bases", {"bases.svg", "factors.svg"});
  EXPECT_THAT(run(folder / "missing.off"), StudyRefusedNaming("missing.off", "No such file"));
}

TEST(DynamicChart, ComparesOurSettingsWithThePapers) {
  const test::TemporaryFolder folder;
  const std::string path = REFIELD_SOURCE_DIR "/tests/support/moving_ball.toml", chart = folder / "chart";
  ASSERT_THAT(run_studies({"dynamic-chart", path, "-o", chart, "--paths", "16", "--traced", "64"}),
              Succeeded());
  ASSERT_THAT(test::run_refield({"render", path, "-o", chart + "/ours.exr"}), Succeeded());
  const Image ours = read_image(chart + "/ours.exr"), traced = read_image(chart + "/traced.exr");
  double difference = 0.0, sum = 0.0;
  for (std::size_t i = 0; i < ours.values.size(); ++i) {
    difference += std::abs(ours.values[i] - traced.values[i]);
    sum += traced.values[i];
  }
  EXPECT_GT(difference, 0.0);
  EXPECT_LT(difference, 0.08 * sum);
  std::ifstream csv(chart + "/dynamic.csv");
  std::string head, row;
  std::getline(csv, head);
  EXPECT_TRUE(head.starts_with("method,setting,megabytes,frame_ms,direct_ms,"));
  EXPECT_NE(head.find("bounced of all"), std::string::npos);
  std::map<std::string, int> rows;
  while (std::getline(csv, row)) ++rows[row.substr(1, row.find('"', 1) - 1)];
  EXPECT_EQ(rows["as in the paper, K = 4"], 4);
  EXPECT_EQ(rows["rays from vertices"], 6);
  EXPECT_EQ(rows["shadow rays, by points"], 7);
  EXPECT_EQ(rows["as in the paper, by order"], 4);
  draws(chart, {"dynamic.svg"});
}

TEST(PackChart, ComparesSizeAndError) {
  const test::TemporaryFolder folder;
  Rng rng(1);
  write_reflectance_field(folder / "f.rfield", test::random_field(rng, 64, 48, {32, 24}, 300, 25));
  const auto result = run_studies({"pack-chart", folder / "f.rfield", "-o", folder / "chart", "--json"});
  ASSERT_THAT(result, Succeeded());
  const auto series = nlohmann::json::parse(result.out);
  ASSERT_EQ(series.size(), 7u);
  for (const auto& figures : series) EXPECT_LE(figures["error"], figures["error_bound"]);
  EXPECT_LT(series.front()["bytes"], series.back()["bytes"]);
  std::ifstream table(folder / "chart/pack.csv");
  std::vector<std::string> lines;
  for (std::string line; std::getline(table, line);) lines.push_back(line);
  ASSERT_EQ(lines.size(), 8u);
  EXPECT_EQ(lines[0],
            "error_bound,full_megabytes,megabytes,weight_bits,pruned,white,texels,bar,square,smooth");
  EXPECT_FALSE(std::filesystem::exists(folder / "chart/packing.rfield"));
  draws(folder / "chart", {"pack.svg"});
}

}  // namespace
}  // namespace refield
