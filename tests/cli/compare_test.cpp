// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "core/capture_session.h"
#include "core/files.h"
#include "core/image_io.h"
#include "core/reflectance_field_file.h"
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
    EXPECT_NEAR(figures["psnr_db"].get<double>(), 20.0 * std::log10(5.0), rounding * 20);
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
  EXPECT_TRUE(json::parse(result.out)["psnr_db"].is_null());
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
