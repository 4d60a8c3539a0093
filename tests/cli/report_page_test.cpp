// SPDX-License-Identifier: Apache-2.0
// The report as a whole, on a tiny session whose exact transport is known.
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <regex>

#include "cli/report/report.h"
#include "cli/report/request.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/field/field_statistics.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/image_io.h"
#include "core/image/metrics.h"
#include "core/session/capture_session.h"
#include "tests/cli/matchers.h"
#include "tests/support/random_data.h"
#include "tests/support/series_error.h"
#include "tests/support/temporary_folder.h"

namespace refield::report {
namespace {

namespace fs = std::filesystem;
using test::RefusedNaming;
using test::run_refield;

constexpr LightDomain domain{12, 9, Parameterisation::monitor};
constexpr int width = 8, height = 6;
constexpr double camera_gain_error = 1.05;  // photographs are 5 % brighter than the exact images
constexpr double rounding = 1e-5;

class ReportPage : public testing::Test {
 protected:
  ReportPage() {
    create_folders(session_.folder);
    session_.light = domain;
    session_.width = width;
    session_.height = height;
    for (int i = 0; i < 30; ++i) add_frame("train_" + std::to_string(i), FrameRole::train, "natural");
    for (int i = 0; i < 3; ++i) add_frame("test_" + std::to_string(i), FrameRole::test, "natural");
    for (int i = 0; i < 2; ++i) add_frame("bar_" + std::to_string(i), FrameRole::test, "bar");
    write_session_manifest(session_);
    create_folders(truth_);
    write_reflectance_field(truth_ / "transport.rfield", transport_);
    write_reflectance_field(field_path_, field_);
    request_ = {Session(session_.folder), {field_path_}, truth_, {}, page_};
  }

  void add_frame(const std::string& name, FrameRole role, const std::string& kind) {
    LightMap light = test::random_light(rng_, domain);
    if (kind == "bar")
      for (int y = 0; y < domain.height; ++y)
        for (int x = 0; x < domain.width; ++x)
          for (int c = 0; c < 3; ++c) light.radiance.at(x, y, c) = x / 4 == 1 ? 1.0f : 0.0f;
    const CaptureFrame frame{name, role, kind, session_.folder / (name + "_light.exr"),
                             session_.folder / (name + "_photo.exr")};
    Image photograph = transport_.relight(light);
    for (float& value : photograph.values) value *= static_cast<float>(camera_gain_error);
    write_exr(frame.illumination, light.radiance);
    write_exr(frame.observed, photograph);
    session_.frames.push_back(frame);
  }

  /// The same measure without the report: all images of a kind at once.
  double expected_error(const std::string& kind, double gain) const {
    std::vector<Image> predicted, reference;
    for (const CaptureFrame& frame : session_.frames_of(FrameRole::test)) {
      if (frame.kind != kind) continue;
      const LightMap light = read_light_map(frame.illumination, domain.parameterisation);
      predicted.push_back(field_.relight(light));
      reference.push_back(transport_.relight(light));
      for (float& value : reference.back().values) value *= static_cast<float>(gain);
    }
    return relative_rmse(predicted, reference);
  }

  /// What the page draws.
  nlohmann::json page_data() const {
    const std::string page = read_text(page_), mark = "id=\"data\">";
    const auto begin = page.find(mark) + mark.size();
    return nlohmann::json::parse(page.substr(begin, page.find("</script>", begin) - begin));
  }

  test::TemporaryFolder folder_;
  Rng rng_{11};
  ReflectanceField transport_ = test::random_field(rng_, width, height, domain, 20, 5);
  ReflectanceField field_ = test::random_field(rng_, width, height, domain, 30, 6);
  CaptureSession session_{folder_ / "session", {}, 0, 0, {}, {}, {}};
  fs::path truth_ = folder_ / "truth";
  fs::path field_path_ = folder_ / "a <field>.rfield";
  fs::path page_ = folder_ / "report.html";
  ReportRequest request_{Session(CaptureSession())};
};

TEST_F(ReportPage, FiguresAreTheMetrics) {
  const auto figures = write_report(request_);
  const auto& field = figures.at("fields").at(0);
  for (const auto& [reference, gain] : {std::pair{"photographs", camera_gain_error}, {"exact images", 1.0}})
    for (const char* kind : {"natural", "bar"})
      EXPECT_NEAR(field.at("errors").at(reference).at(kind).at("relative_rmse").get<double>(),
                  expected_error(kind, gain), rounding)
          << reference << ", " << kind;
  EXPECT_EQ(field.at("errors").at("exact images").at("natural").at("images"), 3);
  EXPECT_EQ(field.at("file_bytes"), fs::file_size(field_path_));
  EXPECT_DOUBLE_EQ(field.at("statistics").at("share_of_99_percent").get<double>(),
                   kernel_statistics(field_).share_of_99_percent);
  EXPECT_EQ(field.at("options"), nullptr) << "this field records none";
}

TEST_F(ReportPage, PredictedErrorsAreComparedByKindOfLight) {
  const auto predicted_against = [&](const char* reference) {
    write_report(request_);
    const auto errors = page_data().at("fields").at(0).at("errors").at(reference).at("natural");
    return errors.contains("predicted_error") ? errors.at("predicted_error").at("median").get<double>() : NAN;
  };
  EXPECT_TRUE(std::isnan(predicted_against("photographs"))) << "this field predicts none";
  field_.quality.predicted_error.assign(field_.transfer.rows(), 0.0625f);
  // All of it noise of the photographs, which exact images do not have.
  field_.quality.photograph_noise = field_.quality.predicted_error;
  write_reflectance_field(field_path_, field_);
  EXPECT_EQ(predicted_against("exact images"), 0.0);
  request_.truth.clear();
  EXPECT_EQ(predicted_against("photographs"), 0.0625);
}

TEST_F(ReportPage, PageStandsAlone) {
  write_report(request_);
  const std::string page = read_text(page_);
  EXPECT_EQ(page.find("a <field>"), std::string::npos) << "names are escaped";
  EXPECT_EQ(page_data().at("fields").at(0).at("label"), "a <field>");
  EXPECT_EQ(page.find("http"), std::string::npos) << "nothing is loaded from elsewhere";
  const std::regex address("(src|href|\"png\")[=:]\"([^\"]{0,22})");
  std::size_t pictures = 0;
  for (std::sregex_iterator found(page.begin(), page.end(), address), end; found != end; ++found)
    if ((*found)[2].str().starts_with("data:image/png;base64,"))
      ++pictures;
    else
      EXPECT_TRUE((*found)[2].str().starts_with("${")) << (*found)[2] << ": the script fills it in";
  EXPECT_GT(pictures, 20u);
}

TEST_F(ReportPage, EqualInputsGiveEqualPagesButForTimes) {
  const auto without_times = [&] {
    write_report(request_);
    return std::regex_replace(read_text(page_), std::regex("\"relight_ms\":[0-9.e-]+"), "");
  };
  const std::string first = without_times();
  EXPECT_EQ(first, without_times());
}

TEST_F(ReportPage, AskedPixelsAreShown) {
  request_.pixels = {{3, 2}, {0, 5}};
  const auto figures = write_report(request_);
  ASSERT_EQ(figures.at("pixels").size(), 2u);
  EXPECT_EQ(figures.at("pixels").at(1).at("y"), 5);
  request_.pixels = {{width, 0}};
  EXPECT_THROW(write_report(request_), InputError);
}

TEST_F(ReportPage, TheCaptureIsChecked) {
  write_report(request_);
  EXPECT_EQ(page_data().at("check").at("residuals_before").size(), 30u) << "a residual for each photograph";
}

TEST_F(ReportPage, SessionWithoutHeldOutFramesStillGetsAPage) {
  std::erase_if(session_.frames, [](const CaptureFrame& frame) { return frame.role == FrameRole::test; });
  request_.session = Session(CaptureSession(session_));
  const auto figures = write_report(request_);
  EXPECT_TRUE(figures.at("fields").at(0).at("errors").empty());
  EXPECT_EQ(page_data().at("first"), nullptr);
}

TEST_F(ReportPage, RefusesWhatDoesNotFitAndLeavesTheOldPage) {
  write_text_atomically(page_, "old page");
  const std::string session = session_.folder, page = page_;
  EXPECT_THAT(run_refield({"compare", folder_ / "none.rfield", session, "-o", page}),
              RefusedNaming("none.rfield", "refield estimate"));
  ReflectanceField other = test::random_field(rng_, width + 1, height, domain, 5, 3);
  write_reflectance_field(folder_ / "other.rfield", other);
  EXPECT_THAT(run_refield({"compare", folder_ / "other.rfield", session, "-o", page}),
              RefusedNaming("other.rfield", "estimated from this session"));
  other = test::random_field(rng_, width, height, {24, 18, Parameterisation::monitor}, 5, 3);
  write_reflectance_field(folder_ / "other.rfield", other);
  EXPECT_THAT(run_refield({"compare", folder_ / "other.rfield", session, "-o", page}),
              RefusedNaming("other.rfield", "24×18"));
  EXPECT_THAT(run_refield({"compare", field_path_, session, "--truth", folder_ / "none", "-o", page}),
              RefusedNaming("none", "refield simulate"));
  EXPECT_THAT(run_refield({"compare", field_path_, session, "--pixel", "3;4", "-o", page}),
              RefusedNaming("3;4", "--pixel 80,60"));
  EXPECT_EQ(read_text(page_), "old page");
}

TEST_F(ReportPage, PairsOfImagesInsteadOfASession) {
  // Of all pairs, the field was estimated from those of the training.
  field_.provenance = "{\"frames\": [";
  for (int i = 0; i < 30; ++i)
    field_.provenance += (i > 0 ? ", \"train_" : "\"train_") + std::to_string(i) + "_light\"";
  field_.provenance += "]}";
  write_reflectance_field(field_path_, field_);
  const auto result = run_refield({"compare", field_path_, "--light", session_.folder / "*_light.exr",
                                   "--observed", session_.folder / "*_photo.exr", "--json", "-o", page_});
  ASSERT_THAT(result, test::Succeeded()) << result.err;
  const auto figures = nlohmann::json::parse(result.out);
  EXPECT_EQ(figures.at("session").at("training_images"), 30);
  const auto& all = figures.at("fields").at(0).at("errors").at("photographs").at("all");
  EXPECT_EQ(all.at("images"), 5);
  ASSERT_EQ(all.at("per_image").size(), 5u);
  EXPECT_EQ(all.at("per_image").at(0).at("name"), "bar_0_light");
  EXPECT_EQ(page_data().at("session").at("is_folder"), false);
  EXPECT_TRUE(page_data().at("fields").at(0).at("errors").at("photographs").at("all").contains("spread"));
}

TEST_F(ReportPage, ProgramPrintsFiguresAndPath) {
  const auto result = run_refield({"compare", field_path_, session_.folder, "--json", "-o", page_});
  ASSERT_THAT(result, test::Succeeded());
  const auto figures = nlohmann::json::parse(result.out);
  EXPECT_EQ(figures.at("report"), page_.string());
  EXPECT_NEAR(
      figures.at("fields").at(0).at("errors").at("photographs").at("bar").at("relative_rmse").get<double>(),
      expected_error("bar", camera_gain_error), rounding);
}

}  // namespace
}  // namespace refield::report
