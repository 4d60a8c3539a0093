// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <limits>
#include <nlohmann/json.hpp>
#include <numeric>
#include <vector>

#include "cli/report/page.h"
#include "cli/report/report.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/image/image_io.h"
#include "tests/support/interruption.h"
#include "tests/support/random_data.h"
#include "tests/support/temporary_folder.h"

namespace refield::report {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

constexpr LightDomain domain{16, 12, Parameterisation::monitor};
/// Sums of a few float32 products.
constexpr float rounding = 1e-5f;

/// A field with one box a pixel, of weight 1 over its area.
ReflectanceField one_box_field(int width, int height, const std::function<Box(int, int)>& box_of) {
  ReflectanceField field;
  field.width = width;
  field.height = height;
  field.basis.domain = domain;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const Box box = box_of(x, y);
      const float weight = 1.0f / static_cast<float>(box.area());
      field.transfer.append_row(std::array{static_cast<std::uint32_t>(field.basis.boxes.size())},
                                std::array{weight, weight, weight});
      field.basis.boxes.push_back(box);
    }
  return field;
}

TEST(ReportText, Base64OfRfc4648) {
  const auto encoded = [](const std::string& text) {
    return base64({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
  };
  EXPECT_EQ(encoded(""), "");
  EXPECT_EQ(encoded("f"), "Zg==");
  EXPECT_EQ(encoded("fo"), "Zm8=");
  EXPECT_EQ(encoded("foo"), "Zm9v");
  EXPECT_EQ(encoded("foobar"), "Zm9vYmFy");
  EXPECT_EQ(encoded(std::string("\xff\xfe\x00", 3)), "//4A");
}

TEST(ReportText, NumbersForReaders) {
  EXPECT_EQ(significant(0.012345, 3), "0.0123");
  EXPECT_EQ(significant(9.996, 3), "10.0");
  EXPECT_EQ(significant(1234.5, 2), "1200");
  EXPECT_EQ(significant(-0.5, 1), "-0.5");
  EXPECT_EQ(significant(0.0, 3), "0");
  EXPECT_EQ(significant(std::numeric_limits<double>::quiet_NaN(), 1), "–");
  EXPECT_EQ(bytes_text(999), "999 bytes");
  EXPECT_EQ(bytes_text(4.0e9), "4.00 GB");
  for (const auto& [value, up] :
       {std::pair{0.031, 0.05}, {0.02, 0.02}, {2.1, 2.5}, {6.0, 10.0}, {100.0, 100.0}})
    EXPECT_NEAR(round_up(value), up, 1e-12 * up) << value;
}

TEST(ReportText, DataDoNotEndTheScriptThatHoldsThem) {
  const std::string page = page_html({{"page", "report"}, {"name", "a</script><b>"}});
  EXPECT_THAT(page, HasSubstr("a\\u003c/script>\\u003cb>"));
  EXPECT_TRUE(page.starts_with("<!DOCTYPE html>"));
  EXPECT_TRUE(page.ends_with("</html>\n"));
}

TEST(ReportPicture, ShrinkingKeepsMeansAndMaxima) {
  Image image(5, 3, 1);
  std::iota(image.values.begin(), image.values.end(), 0.0f);
  const Image mean = shrunk(image, 3);  // blocks of 2 × 2, cut at the right and the bottom
  EXPECT_THAT(mean.values, ElementsAre(3.0f, 5.0f, 6.5f, 10.5f, 12.5f, 14.0f));
  EXPECT_THAT(shrunk_by_maximum(image, 3).values, ElementsAre(6.0f, 8.0f, 9.0f, 11.0f, 13.0f, 14.0f));
  EXPECT_EQ(shrunk(image, 5).values, image.values);
}

TEST(ReportPicture, ExposureShowsThe99thPercentileAsWhite) {
  Image image(10, 10, 3, 0.037f);
  EXPECT_DOUBLE_EQ(display_exposure(image, {}), 27.0) << "1 / 0.037, two digits";
  Mask mask(100, 0);
  mask[7] = 1;
  image.at(7, 0, 1) = 0.5f;
  EXPECT_DOUBLE_EQ(display_exposure(image, mask), 2.0) << "the brightest channel, inside the mask alone";
  EXPECT_DOUBLE_EQ(display_exposure(Image(4, 4, 3), {}), 1.0) << "black";
}

TEST(ReportPicture, ErrorIsTheRootMeanSquareOfTheChannels) {
  Image a(2, 1, 3, 1.0f), b(2, 1, 3, 1.0f);
  b.at(1, 0, 0) = 4.0f;
  b.at(1, 0, 2) = -2.0f;
  EXPECT_THAT(error_magnitude(a, b).values, ElementsAre(0.0f, testing::FloatNear(std::sqrt(6.0f), rounding)));
  EXPECT_THROW(error_magnitude(a, Image(1, 1, 3)), InputError);
}

TEST(ReportPicture, FalseColoursRiseInLightnessAndMarkTheMask) {
  Image ramp(101, 1, 1);
  for (int i = 0; i <= 100; ++i) ramp.values[i] = 0.02f * static_cast<float>(i);
  const Image colours = false_coloured(ramp, 1.0, {});
  const auto luminance = [&](int i) {
    return 0.2126f * colours.at(i, 0, 0) + 0.7152f * colours.at(i, 0, 1) + 0.0722f * colours.at(i, 0, 2);
  };
  for (int i = 1; i <= 50; ++i) EXPECT_GT(luminance(i), luminance(i - 1)) << i;
  for (int i = 51; i <= 100; ++i)
    EXPECT_EQ(luminance(i), luminance(50)) << "above the range: the last colour";
  const Image outside = false_coloured(ramp, 1.0, Mask(101, 0));
  EXPECT_EQ(outside.at(0, 0, 0), outside.at(100, 0, 2));
}

TEST(ReportPixels, SpreadOfOneBoxIsThatOfAUniformDistribution) {
  const ReflectanceField field = one_box_field(1, 1, [](int, int) { return Box{2, 3, 14, 8}; });
  const KernelSpread spread = kernel_spreads(field).front();
  EXPECT_NEAR(spread.energy, 1.0, rounding);
  EXPECT_NEAR(spread.spread, std::sqrt(12.0 * 12.0 / 12.0 + 5.0 * 5.0 / 12.0) / 20.0, rounding);
  EXPECT_NEAR(spread.peak, 16.0 * 12.0 / (12.0 * 5.0), rounding);
}

TEST(ReportPixels, ChoosesOneOfEachKind) {
  // Left third: a single texel, as in a mirror; the rest: the whole map, as on a diffuse surface.
  const ReflectanceField field = one_box_field(30, 20, [](int x, int) {
    return x < 10 ? Box{4, 4, 5, 5} : Box{0, 0, 16, 12};
  });
  const auto pixels = choose_pixels(field, {});
  ASSERT_GE(pixels.size(), 4u);
  EXPECT_LT(pixels[0].x, 10) << pixels[0].kind;
  EXPECT_GE(pixels[3].x, 10) << pixels[3].kind;
  for (std::size_t i = 0; i < pixels.size(); ++i)
    for (std::size_t j = 0; j < i; ++j)
      EXPECT_GE(std::hypot(pixels[i].x - pixels[j].x, pixels[i].y - pixels[j].y), 3.0);
  Mask mask(600, 0);
  mask[5 * 30 + 20] = 1;
  const auto masked = choose_pixels(field, mask);
  ASSERT_EQ(masked.size(), 1u);
  EXPECT_EQ(masked[0].x, 20);
  EXPECT_EQ(masked[0].y, 5);
}

TEST(ReportPixels, DensityIsTheRowOfTheTransfer) {
  Rng rng(3);
  const ReflectanceField field = test::random_field(rng, 4, 3, domain, 20, 6);
  const LightMap light = test::random_light(rng, domain);
  const Image image = field.relight(light);
  for (std::size_t p = 0; p < 12; ++p) {
    const Image density = kernel_density(field, p);
    // Under grey light, the mean of the channels is the density's product with the light.
    LightMap grey = light;
    for (std::size_t t = 0; t < density.values.size(); ++t)
      grey.radiance.values[3 * t + 1] = grey.radiance.values[3 * t + 2] = grey.radiance.values[3 * t];
    const Image lit = field.relight(grey);
    double sum = 0.0;
    for (std::size_t t = 0; t < density.values.size(); ++t)
      sum += density.values[t] * grey.radiance.values[3 * t];
    const double mean = (lit.values[3 * p] + lit.values[3 * p + 1] + lit.values[3 * p + 2]) / 3.0;
    EXPECT_NEAR(sum, mean, 1e-4 * (1.0 + mean)) << "pixel " << p;
  }
}

// These took up to half a minute for a large field.
TEST(ReportPixels, TheChoiceEndsOnAnInterruption) {
  Rng rng(5);
  const ReflectanceField field = test::random_field(rng, 40, 30, {16, 12}, 60, 5);
  EXPECT_TRUE(test::heeds_interruption([&](const RunContext& run) { kernel_spreads(field, run); }));
  EXPECT_TRUE(test::heeds_interruption([&](const RunContext& run) { choose_pixels(field, {}, run); }));
}

TEST(ReportEvaluation, KindsInReadingOrderAndFramesSpread) {
  CaptureSession session;
  for (const char* kind : {"square", "black", "natural", "odd", "bar"})
    for (int i = 0; i < 5; ++i)
      session.frames.push_back({kind + std::to_string(i), FrameRole::test, kind, "l.exr", "o.exr"});
  session.frames.push_back({"t", FrameRole::train, "train-only", "l.exr", "o.exr"});
  EXPECT_THAT(kinds_of(session), ElementsAre("natural", "bar", "square", "odd", "black"));
  const auto chosen = spread_frames(session, "natural", 2);
  ASSERT_EQ(chosen.size(), 2u);
  EXPECT_EQ(chosen[0].name, "natural1");
  EXPECT_EQ(chosen[1].name, "natural3");
  EXPECT_EQ(spread_frames(session, "bar", 9).size(), 5u);
  EXPECT_TRUE(spread_frames(session, "train-only", 2).empty());
}

TEST(ReportCheck, ShowsTheModelOfTheRigWhereThereIsOne) {
  FrameReport found;
  found.residuals_before = {0.08, 0.09, 0.2};
  found.residuals = {0.04, 0.04, 0.05};
  found.rig.findings = {{"motion", RigFinding::State::good, 0.0, "the camera rested", 0.05, 0.05}};
  const auto good = check_json(found, 3);
  EXPECT_EQ(good.at("rows").at(0).at("measured"), "the camera rested");
  EXPECT_EQ(good.at("residuals_before"), nlohmann::json(found.residuals_before));
  for (const char* none : {"residuals_corrected", "shift_px", "gain", "room"})
    EXPECT_TRUE(good.at(none).empty()) << none;
  EXPECT_EQ(good.at("mixing"), nullptr);
  found.rig.findings.front().state = RigFinding::State::corrected;
  found.rig.model.shift_px = {{0.0, 0.0}, {-0.125, -0.25}, {-0.25, -0.5}};  // to the left and up alone
  found.rig.model.gain = {{1.0, 1.0, 1.0}, {1.02, 1.0, 0.98}, {0.98, 1.0, 1.02}};
  found.rig.model.mixing(0, 1) = 0.125;
  const auto corrected = check_json(found, 3);
  EXPECT_THAT(corrected.at("rows").at(0).at("remedy").get<std::string>(), HasSubstr("fix the camera"));
  EXPECT_EQ(corrected.at("shift_px").at(2), nlohmann::json({-0.25, -0.5}));
  EXPECT_EQ(corrected.at("gain").at(1).at(0), 1.02);
  EXPECT_EQ(corrected.at("mixing").at(0).at(1), 0.125);
  EXPECT_EQ(corrected.at("residuals_corrected"), nlohmann::json(found.residuals));
}

TEST(ReportInputs, OptionsOfAnEstimation) {
  const auto flat = options_from_provenance(R"({"mode": "paper", "kernels": 12, "spatial_passes": 0})");
  ASSERT_TRUE(flat);
  EXPECT_EQ(flat->mode, EstimateMode::paper);
  EXPECT_EQ(flat->kernels, 12);
  EXPECT_EQ(flat->spatial_passes, 0);
  for (const char* other :
       {"{}", "no json", R"({"mode": "future", "kernels": 3})", R"({"mode": "paper"})", "[]"})
    EXPECT_FALSE(options_from_provenance(other)) << other;
}

TEST(ReportRunLog, ReadsWhatStagesWrite) {
  const test::TemporaryFolder folder;
  const auto path = folder / "a.log.json";
  EXPECT_FALSE(read_run_log(path));
  write_text_atomically(path,
                        R"({"stage": "estimate", "seconds": 2.5, "peak_memory_bytes": 1000, "threads": 2,
                                  "bands": 4, "estimated_memory_bytes": 2000000, "share": 0.123456})");
  const auto log = read_run_log(path);
  ASSERT_TRUE(log);
  EXPECT_EQ(log->stage, "estimate");
  EXPECT_EQ(log->seconds, 2.5);
  EXPECT_EQ(log->peak_memory_bytes, 1000u);
  EXPECT_EQ(log->threads, 2);
  EXPECT_EQ(log->details, "bands 4, estimated memory 2.00 MB, share 0.123");
  EXPECT_EQ(run_log_path("a/b.rfield"), "a/b.rfield.log.json");
  EXPECT_EQ(run_log_path("a/session/"), "a/session.log.json");
  write_run_log(folder / "session/", "acquire", 1.5, {{"lights", 7}});
  const auto written = read_run_log(folder / "session.log.json");
  ASSERT_TRUE(written);
  EXPECT_EQ(written->stage, "acquire");
  EXPECT_EQ(written->seconds, 1.5);
  EXPECT_GT(written->peak_memory_bytes, 1000000u) << "this very process holds more";
  EXPECT_EQ(written->details, "lights 7");
  write_text_atomically(path, "stage: estimate");
  EXPECT_THROW(read_run_log(path), FormatError);
}

}  // namespace
}  // namespace refield::report
