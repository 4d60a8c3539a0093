// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>

#include "core/base/files.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/image_io.h"
#include "core/light/light_map.h"
#include "core/session/capture_session.h"
#include "tests/cli/matchers.h"
#include "tests/support/random_data.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::RefusedNaming;
using test::run_refield;
using test::Succeeded;

constexpr double rounding = 1e-5;

class CompareVerb : public testing::Test {
 protected:
  CompareVerb() {
    fs::create_directory(folder_ / "p");
    fs::create_directory(folder_ / "o");
    for (const char* name : {"1.exr", "2.exr"}) {
      write_exr(folder_ / "p" / name, Image(4, 3, 3, 1.2f));
      write_exr(folder_ / "o" / name, Image(4, 3, 3, 1.0f));
    }
  }
  test::TemporaryFolder folder_;
};

TEST_F(CompareVerb, FoldersPatternsAndSingleImages) {
  const std::pair<std::string, std::string> pairs[] = {{folder_ / "p", folder_ / "o"},
                                                       {folder_ / "p/*.exr", folder_ / "o/*.exr"},
                                                       {folder_ / "p/1.exr", folder_ / "o/2.exr"}};
  for (const auto& [predicted, observed] : pairs) {
    const auto result = run_refield({"compare", predicted, observed, "--json"});
    ASSERT_THAT(result, Succeeded());
    const json figures = json::parse(result.out);
    EXPECT_NEAR(figures["relative_rmse"].get<double>(), 0.2, rounding);
    EXPECT_NEAR(figures["median"].get<double>(), 0.2, rounding);
    EXPECT_NEAR(figures["percentile_90"].get<double>(), 0.2, rounding);
    // At an exposure of one the prediction clips: on the screen the pictures are the same.
    EXPECT_TRUE(figures["tone_mapped_psnr_db"].is_null());
    for (const auto& image : figures["per_image"]) {
      EXPECT_NEAR(image["relative_rmse"].get<double>(), 0.2, rounding);
      EXPECT_NE(image["observed"].get<std::string>().find("/o/"), std::string::npos);
    }
    EXPECT_EQ(figures["per_image"].size(), figures["images"]);
  }
}

TEST_F(CompareVerb, OnlyPixelsOfTheMaskCount) {
  Image predicted(4, 3, 3, 1.2f);
  predicted.at(0, 0, 1) = NAN;
  write_exr(folder_ / "p/1.exr", predicted);
  EXPECT_THAT(run_refield({"compare", folder_ / "p", folder_ / "o"}), RefusedNaming("p/1.exr", "--mask"));
  Image mask(4, 3, 1, 1.0f);
  mask.at(0, 0, 0) = 0.0f;
  write_png(folder_ / "mask.png", mask);
  const auto result = run_refield({"compare", folder_ / "p", folder_ / "o", "--mask", folder_ / "mask.png",
                                   "--json", "-o", folder_ / "error.exr"});
  ASSERT_THAT(result, Succeeded());
  EXPECT_NEAR(json::parse(result.out)["relative_rmse"].get<double>(), 0.2, rounding);
  const Image map = read_image(folder_ / "error.exr");
  EXPECT_EQ(map.at(0, 0, 0), 0.0f);
  EXPECT_NEAR(map.at(1, 0, 0), 0.2, rounding);
}

TEST_F(CompareVerb, EqualImagesHaveNoFinitePsnr) {
  const auto result = run_refield({"compare", folder_ / "o", folder_ / "o", "--json"});
  EXPECT_EQ(json::parse(result.out)["relative_rmse"], 0.0);
  EXPECT_TRUE(json::parse(result.out)["tone_mapped_psnr_db"].is_null());
}

TEST_F(CompareVerb, NamesWhatDoesNotFit) {
  write_exr(folder_ / "wide.exr", Image(5, 3, 3, 1.0f));
  EXPECT_THAT(run_refield({"compare", folder_ / "wide.exr", folder_ / "o/1.exr"}),
              RefusedNaming("wide.exr", "5×3"));
  fs::remove(folder_ / "o/2.exr");
  EXPECT_THAT(run_refield({"compare", folder_ / "p", folder_ / "o"}),
              RefusedNaming("p/2.exr", "observed image"));
  EXPECT_THAT(run_refield({"compare", folder_ / "q", folder_ / "o"}), RefusedNaming("/q", "no file"));
}

/// Pairs of images of another tool, and a field that says which of them it was made from.
class ComparePairs : public testing::Test {
 protected:
  static constexpr int pairs = 6;

  ComparePairs() {
    create_folders(folder_ / "light");
    create_folders(folder_ / "observed");
    for (int i = 0; i < pairs; ++i) {
      const LightMap light = test::random_light(rng_, field_.basis.domain);
      Image photograph = field_.relight(light);
      for (float& value : photograph.values) value *= i == 4 ? 2.0f : 1.25f;
      write_exr(folder_ / ("light/" + std::to_string(i) + ".exr"), light.radiance);
      write_exr(folder_ / ("observed/" + std::to_string(i) + ".exr"), photograph);
    }
  }
  json compare(const std::string& provenance, const std::vector<std::string>& more = {}) {
    field_.provenance = provenance;
    write_reflectance_field(folder_ / "f.rfield", field_);
    std::vector<std::string> arguments = {"compare",    folder_ / "f.rfield", "--light", folder_ / "light",
                                          "--observed", folder_ / "observed", "--json"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const auto result = run_refield(arguments);
    EXPECT_THAT(result, Succeeded()) << result.err;
    warning_ = result.err;
    return json::parse(result.out)["held_out"]["all"];
  }

  test::TemporaryFolder folder_;
  Rng rng_{1};
  ReflectanceField field_ = test::random_field(rng_, 10, 7, {8, 6}, 20, 5);
  std::string warning_;
};

TEST_F(ComparePairs, EachPairHasItsError) {
  const json figures = compare("");
  ASSERT_EQ(figures["per_image"].size(), std::size_t{pairs});
  for (const auto& image : figures["per_image"]) {
    const bool worst = image["name"] == "4";
    EXPECT_NEAR(image["relative_rmse"].get<double>(), worst ? 0.5 : 0.2, rounding);
    EXPECT_EQ(fs::path(image["observed"].get<std::string>()).filename(),
              image["name"].get<std::string>() + ".exr");
  }
  const auto text = run_refield({"compare", folder_ / "f.rfield", "--light", folder_ / "light/*.exr",
                                 "--observed", folder_ / "observed/*.exr"});
  EXPECT_NE(text.out.find("0.5000  4\n"), std::string::npos) << text.out;
}

TEST_F(ComparePairs, OnlyThoseThatTheFieldWasNotEstimatedFrom) {
  const json held_out = compare(R"({"frames": ["0", "1", "3"], "left_out": ["5"]})");
  ASSERT_EQ(held_out["images"], 2);
  EXPECT_EQ(held_out["per_image"][0]["name"], "2");
  EXPECT_EQ(held_out["per_image"][1]["name"], "4");
  EXPECT_EQ(held_out["trained_on"], 0);
  EXPECT_EQ(warning_.find("warning"), std::string::npos);
  // By the user's word, whatever the field says; but what it says is told.
  EXPECT_EQ(compare(R"({"frames": ["0", "1", "3"]})", {"--hold-out", "3"})["per_image"][0]["name"], "2");
  const json trained = compare(R"({"frames": ["0", "1", "2", "3", "4", "5"]})", {"--hold-out", "3"});
  EXPECT_EQ(trained["images"], 2);
  EXPECT_EQ(trained["trained_on"], 2);
  EXPECT_NE(warning_.find("2 of the 2 photographs"), std::string::npos) << warning_;
  // Fields of arrays, and of others' estimators, name none; those of a simulation were not estimated.
  EXPECT_TRUE(compare(R"({"made_by": "refield estimate"})")["trained_on"].is_null());
  EXPECT_NE(warning_.find("does not name the photographs"), std::string::npos) << warning_;
  EXPECT_EQ(compare(R"({"program": "refield 1"})")["trained_on"], 0);
  EXPECT_EQ(warning_.find("warning"), std::string::npos);
  // Names of another series: all pairs count, and where some have a known name, the user is warned.
  EXPECT_EQ(compare(R"({"frames": ["a", "b"]})")["images"], pairs);
  EXPECT_EQ(warning_.find("warning"), std::string::npos);
  EXPECT_EQ(compare(R"({"frames": ["a", "b", "1"]})")["images"], pairs);
  EXPECT_NE(warning_.find("1 of the 6 photographs"), std::string::npos) << warning_;
}

TEST_F(ComparePairs, LightOfTrainingImagesIsRecognisedUnderOtherNamesAndInOtherEncodings) {
  const Image light = read_image(folder_ / "light/2.exr");
  const std::string provenance = R"({"frames": ["a"], "lights": [")" + pattern_of(light) + R"("]})";
  EXPECT_EQ(compare(provenance)["trained_on"], 1);
  EXPECT_NE(warning_.find("1 of the 6 photographs"), std::string::npos) << warning_;
  Image other = light;
  for (float& value : other.values) value *= 0.3f;
  write_exr(folder_ / "light/2.exr", other, Precision::half);
  EXPECT_EQ(compare(provenance)["trained_on"], 1);
  const float white = *std::ranges::max_element(light.values);
  for (float& value : other.values) value /= 0.3f * white;  // of half precision
  write_png(folder_ / "light/2.png", other, {});
  fs::remove(folder_ / "light/2.exr");
  EXPECT_EQ(compare(provenance)["trained_on"], 1);
  fs::remove(folder_ / "light/2.png");
  other = light;
  other.values[5] += 0.5f * white;
  write_exr(folder_ / "light/2.exr", other);
  EXPECT_EQ(compare(provenance)["trained_on"], 0);
}

TEST_F(ComparePairs, NamesWhatIsMissing) {
  compare("");
  const std::string field = folder_ / "f.rfield", light = folder_ / "light";
  EXPECT_THAT(run_refield({"compare", field}), RefusedNaming("SESSION", "--light"));
  EXPECT_THAT(run_refield({"compare", field, "--light", light}), RefusedNaming("--light", "--observed"));
  EXPECT_THAT(run_refield({"compare", field, "--light", light, "--observed", light, "--hold-out", "9"}),
              RefusedNaming("--hold-out 9", "smaller number"));
  EXPECT_THAT(run_refield({"compare", light, "--light", light, "--observed", light}),
              RefusedNaming("--light", ".rfield"));
}

TEST_F(CompareVerb, AFieldAgainstASessionsHeldOutFrames) {
  Rng rng(1);
  CaptureSession session;
  session.folder = folder_ / "session";
  session.light = {8, 6};
  session.width = 10;
  session.height = 7;
  const ReflectanceField field = test::random_field(rng, 10, 7, session.light, 20, 5);
  write_reflectance_field(folder_ / "f.rfield", field);
  create_folders(session.folder);
  const LightMap light = test::random_light(rng, session.light);
  for (const char* kind : {"natural", "bar"}) {
    const fs::path light_path = session.folder / (std::string(kind) + "_light.exr");
    const fs::path photo_path = session.folder / (std::string(kind) + ".exr");
    write_exr(light_path, light.radiance);
    write_exr(photo_path, field.relight(light));
    session.frames.push_back({kind, FrameRole::test, kind, light_path, photo_path});
  }
  write_session_manifest(session);
  for (const std::vector<std::string>& truth :
       {std::vector<std::string>{}, std::vector<std::string>{"--truth", folder_ / "f.rfield"}}) {
    std::vector<std::string> arguments = {"compare", folder_ / "f.rfield", session.folder, "--json"};
    arguments.insert(arguments.end(), truth.begin(), truth.end());
    const auto result = run_refield(arguments);
    ASSERT_THAT(result, Succeeded());
    const json figures = json::parse(result.out)["held_out"];
    EXPECT_EQ(figures["natural"]["images"], 1);
    EXPECT_NEAR(figures["bar"]["median"].get<double>(), 0.0, rounding);
  }
}

}  // namespace
}  // namespace refield
