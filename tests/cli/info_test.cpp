// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "cli/acquire/until_error.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/image_io.h"
#include "core/session/capture_session.h"
#include "tests/cli/matchers.h"
#include "tests/support/random_data.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

using nlohmann::json;
using test::RefusedNaming;
using test::run_refield;
using test::Succeeded;

json info_of(const std::string& path) {
  const auto result = run_refield({"info", path, "--json"});
  EXPECT_THAT(result, Succeeded());
  return json::parse(result.out, nullptr, false);
}

TEST(InfoVerb, AField) {
  const test::TemporaryFolder folder;
  Rng rng(1);
  ReflectanceField field = test::random_field(rng, 10, 7, {8, 6}, 20, 5);
  field.provenance = R"({"mode": "refined", "kernels": 9})";
  write_reflectance_field(folder / "f.rfield", field);
  const json info = info_of(folder / "f.rfield");
  EXPECT_EQ(info["image"]["width"], 10);
  EXPECT_EQ(info["light"]["parameterisation"], "monitor");
  EXPECT_EQ(info["distinct_boxes"], 20);
  EXPECT_EQ(info["kernels"]["stored"], field.transfer.entries());
  EXPECT_EQ(info["kernels"]["allowed"].get<int>(), 9 * info["pixels_in_scene"].get<int>());
  EXPECT_EQ(info["provenance"]["kernels"], 9);
  EXPECT_THAT(run_refield({"info", folder / "f.rfield"}).out, testing::HasSubstr("distinct boxes: 20"));
}

// Provenance is whatever the file says: a terminal must not obey it.
TEST(InfoVerb, ControlCharactersOfAFileAreShownAsNumbers) {
  const test::TemporaryFolder folder;
  Rng rng(1);
  ReflectanceField field = test::random_field(rng, 4, 3, {8, 6}, 20, 5);
  const std::string harmless = "Übung – ok";
  for (const std::string& provenance :
       {std::string("\x1b]0;mine\x07\x1b[2J ") + harmless,
        R"({"note": "\u001b[31m )" + harmless + R"(", "\u001bkey": ["\u009b2J"]})"}) {
    field.provenance = provenance;
    write_reflectance_field(folder / "f.rfield", field);
    const auto result = run_refield({"info", folder / "f.rfield"});
    ASSERT_THAT(result, Succeeded());
    EXPECT_EQ(result.out.find_first_of("\x1b\x07"), std::string::npos) << result.out;
    EXPECT_EQ(result.out.find("\xc2\x9b"), std::string::npos) << result.out;
    EXPECT_THAT(result.out, testing::HasSubstr("\\x1b"));
    EXPECT_THAT(result.out, testing::HasSubstr(harmless));
  }
}

TEST(InfoVerb, AnImage) {
  const test::TemporaryFolder folder;
  Image image(3, 2, 3, 0.5f);
  image.values[0] = NAN;
  image.values[1] = INFINITY;
  image.values[2] = -1.0f;
  write_exr(folder / "a.exr", image);
  const json info = info_of(folder / "a.exr");
  EXPECT_EQ(info["radiance"]["nan"], 1);
  EXPECT_EQ(info["radiance"]["infinite"], 1);
  EXPECT_EQ(info["radiance"]["negative"], 1);
  EXPECT_EQ(info["radiance"]["highest"], 0.5);
}

TEST(InfoVerb, ASession) {
  const test::TemporaryFolder folder;
  CaptureSession session;
  session.folder = folder.path();
  session.light = {4, 3};
  session.width = 2;
  session.height = 2;
  write_exr(folder / "l.exr", Image(4, 3, 3, 1.0f));
  write_photograph(folder / "p.exr", {Image(2, 2, 3, 1.0f), Image(2, 2, 3, 0.1f)});
  session.frames = {{"a", FrameRole::train, "natural", folder / "l.exr", folder / "p.exr"},
                    {"b", FrameRole::test, "bar", folder / "l.exr", folder / "p.exr"}};
  write_session_manifest(session);
  const json info = info_of(folder.path());
  EXPECT_EQ(info["frames_by_role_and_kind"]["train"]["natural"], 1);
  EXPECT_EQ(info["frames_by_role_and_kind"]["test"]["bar"], 1);
  EXPECT_EQ(info["frames_with_noise_estimate"], 2);
}

TEST(InfoVerb, OtherFiles) {
  const test::TemporaryFolder folder;
  EXPECT_THAT(run_refield({"info", folder.path()}),
              RefusedNaming(folder.path().string(), "not a capture session"));
  EXPECT_THAT(run_refield({"info", folder / "none.exr"}), RefusedNaming("none.exr", "No such file"));
  std::ofstream(folder / "t.rfield") << "text";
  EXPECT_THAT(run_refield({"info", folder / "t.rfield"}),
              RefusedNaming("t.rfield", "not a reflectance field"));
}

TEST(Program, EveryVerbHasHelp) {
  const auto overview = run_refield({"--help"});
  EXPECT_EQ(overview.status, 0);
  for (const char* verb : {"simulate", "acquire", "estimate", "relight", "compare", "info"}) {
    EXPECT_THAT(overview.out, testing::HasSubstr(verb));
    const auto help = run_refield({verb, "--help"});
    EXPECT_EQ(help.status, 0) << verb << ": " << help.err;
    EXPECT_THAT(help.out, testing::HasSubstr(std::string("Usage: refield ") + verb));
  }
}

/// Lines of at most 100 columns: bytes without the continuation bytes of UTF-8.
void expect_narrow_lines(const std::string& help, const std::string& command) {
  std::istringstream lines(help);
  for (std::string line; std::getline(lines, line);) {
    const auto columns =
        std::ranges::count_if(line, [](char c) { return (static_cast<unsigned char>(c) & 0xc0u) != 0x80u; });
    EXPECT_LE(columns, 100) << command << ": " << line;
  }
}

TEST(Program, HelpFitsOnAScreen) {
  const std::string overview = run_refield({"--help"}).out;
  EXPECT_LE(std::ranges::count(overview, '\n'), 45);
  expect_narrow_lines(overview, "refield");
  EXPECT_THAT(overview,
              testing::HasSubstr(
                  "  estimate    Estimate a reflectance field from photographs under known illumination.\n"));
  const std::vector<std::vector<std::string>> commands = {{"acquire"},           {"acquire", "calibrate"},
                                                          {"acquire", "import"}, {"acquire", "probe"},
                                                          {"acquire", "run"},    {"estimate"},
                                                          {"relight"},           {"simulate"},
                                                          {"precompute"},        {"render"}};
  for (std::vector<std::string> command : commands) {
    command.emplace_back("--help-all");
    const std::string help = run_refield(command).out;
    EXPECT_GT(help.size(), 100u) << command.front();
    expect_narrow_lines(help, command.front());
  }
  // One sentence about each of its verbs, and no more.
  EXPECT_THAT(run_refield({"acquire", "--help"}).out,
              testing::AllOf(testing::HasSubstr("Create light patterns for a monitor.\n"),
                             testing::Not(testing::HasSubstr("refield acquire lights --starter"))));
}

TEST(Program, JsonHasAVersionAndErrorsAreJsonToo) {
  const test::TemporaryFolder folder;
  const auto failed = run_refield({"info", folder / "none.exr", "--json"});
  EXPECT_EQ(failed.status, 2);
  const auto document = nlohmann::json::parse(failed.out);
  EXPECT_EQ(document["schema"], 1);
  EXPECT_EQ(document["error"]["kind"], "device");
  EXPECT_THAT(failed.err, testing::HasSubstr(document["error"]["message"].get<std::string>()));
  EXPECT_EQ(nlohmann::json::parse(run_refield({"pack", "--json"}).out)["error"]["kind"], "usage");
  write_exr(folder / "a.exr", Image(4, 3, 3, 1.0f));
  const auto good = nlohmann::json::parse(run_refield({"--json", "info", folder / "a.exr"}).out);
  EXPECT_EQ(good["schema"], 1);
  EXPECT_FALSE(good.contains("error"));
}

TEST(Program, HelpShowsTheOutputFirstAndNoBounds) {
  for (const char* verb : {"estimate", "precompute", "relight"}) {
    const std::string help = run_refield({verb, "--help"}).out;
    EXPECT_THAT(help, testing::HasSubstr("Options:\n  -o,--output ")) << verb;
    EXPECT_THAT(help, testing::Not(testing::HasSubstr(" in ["))) << verb;
    EXPECT_THAT(help, testing::HasSubstr("--help-all lists")) << verb;
  }
  EXPECT_THAT(run_refield({"estimate", "--help"}).out, testing::Not(testing::HasSubstr("--rows")));
  EXPECT_THAT(run_refield({"estimate", "--help-all"}).out, testing::HasSubstr("--rows"));
}

TEST(Program, DefaultsFollowTheDescription) {
  const std::string help = run_refield({"estimate", "--help"}).out;
  EXPECT_THAT(help, testing::HasSubstr("(default: 4)")) << "of --memory";
  EXPECT_THAT(help, testing::Not(testing::HasSubstr("FLOAT=")));
}

TEST(Program, WrongUseEndsWithStatusTwo) {
  EXPECT_EQ(run_refield({}).status, 2);
  EXPECT_EQ(run_refield({"relit"}).status, 2);
  EXPECT_EQ(run_refield({"info"}).status, 2);
  EXPECT_EQ(run_refield({"info", "x", "--nonsense"}).status, 2);
  EXPECT_EQ(run_refield({"--version"}).status, 0);
}

/// Two photographs of the reference light, the second moved, with another gain, light of the room and noise.
std::vector<VerdictRow> rows_of(double right, double down, double gain, double room, double noise) {
  const test::TemporaryFolder folder;
  Rng rng(1);
  std::vector<std::filesystem::path> files;
  for (const double share : {0.0, 1.0}) {
    Image image(40, 30, 3);
    for (int y = 0; y < 30; ++y)
      for (int x = 0; x < 40; ++x)
        for (int c = 0; c < 3; ++c) {
          const double value =
              2.0 + std::sin(0.4 * (x - share * right)) + 0.5 * std::cos(0.5 * (y - share * down));
          image.at(x, y, c) = static_cast<float>((value * std::lerp(1.0, gain, share) + 2.0 * room * share) *
                                                 (1.0 + noise * rng.normal()));
        }
    files.push_back(folder / (std::to_string(files.size()) + ".exr"));
    write_exr(files.back(), image);
  }
  return cli::compare_references(files);
}

TEST(CompareReferences, TellsMotionAndRoomLightFromDrift) {
  const auto moved = rows_of(0.3, -0.2, 1.02, 0.0, 0.01);
  ASSERT_EQ(moved.size(), 1u);
  EXPECT_EQ(moved[0].property, "motion");
  EXPECT_THAT(moved[0].measured, testing::HasSubstr("moved by about 0.3"));  // 0.36, from noisy pictures
  const auto lit = rows_of(0.0, 0.0, 0.98, 0.1, 0.01);
  ASSERT_EQ(lit.size(), 1u);
  EXPECT_EQ(lit[0].property, "room light");
  EXPECT_THAT(lit[0].measured, testing::HasSubstr("% of its mean more"));
  EXPECT_EQ(rows_of(0.5, 0.5, 1.0, -0.1, 0.0).front().property, "motion");
  for (const double noise : {0.0, 0.02}) EXPECT_TRUE(rows_of(0.0, 0.0, 0.9, 0.0, noise).empty()) << noise;
  EXPECT_TRUE(cli::compare_references({}).empty());
}

}  // namespace
}  // namespace refield
