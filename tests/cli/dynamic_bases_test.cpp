// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "core/files.h"
#include "core/image_io.h"
#include "tests/cli/matchers.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

using test::RefusedNaming;
using test::run_refield;
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
    return run_refield({"simulate", "dynamic-bases", "--mesh", mesh, "--terms", "1", "-o", folder / "bases"});
  };
  ASSERT_THAT(run(small_figure(folder)), Succeeded());
  const std::string csv = read_text(folder / "bases/bases.csv");
  EXPECT_TRUE(csv.starts_with("surface,basis,functions,kept,condition,error,inverse_error\n"));
  const auto floor = errors_of("floor", csv), small = errors_of("small", csv);
  for (const char* other : {"harmonics 16", "wavelets 16", "cosines 16"})
    EXPECT_LT(floor.at("principal 16"), floor.at(other));
  EXPECT_LT(small.at("harmonics 64"), 1e-3) << "six functions tell all that six vertices can hold";
  EXPECT_NE(csv.find("inf"), std::string::npos);
  EXPECT_TRUE(read_text(folder / "bases/factors.csv").starts_with("exponent,terms,error,lamp_error\n4,1,"));
  for (const char* picture : {"bases/bases-floor.png", "bases/bases-figure.png", "bases/factors.png"})
    EXPECT_GT(read_image(folder / picture).width, 100);
  for (const char* chart : {"bases/bases.svg", "bases/factors.svg"})
    EXPECT_NE(read_text(folder / chart).find("</svg>"), std::string::npos);
  EXPECT_THAT(run(folder / "missing.off"), RefusedNaming("missing.off", "No such file"));
}

}  // namespace
}  // namespace refield
