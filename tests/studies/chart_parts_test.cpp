// SPDX-License-Identifier: Apache-2.0
// The chart's parts: rows, verdicts, noise, kinds.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>

#include "bench/studies/chart/derived_kinds.h"
#include "bench/studies/chart/methods.h"
#include "bench/studies/chart/verdict.h"
#include "core/base/errors.h"
#include "core/base/rng.h"
#include "core/image/image_io.h"
#include "tests/support/temporary_folder.h"

namespace refield::chart {
namespace {

const std::vector<std::string> names = {"natural", "natural_median"};

std::vector<ChartRow> rows() {
  return {{"ours", "default", 50, 1.5, 0.1, 300, 17, {0.02, 0.03}},
          {"ours", "10 kernels", 50, 1.0, 0.1, 150, 9, {0.03, 0.01}},
          {"ridge", "", 50, 0.5, 2, 3000, 50, {0.025, 0.02}},
          {"ridge", "", 100, 0.5, 2, 3000, 100, {NAN, 0.02}}};
}

TEST(ChartRows, ComeBackFromTheFile) {
  const test::TemporaryFolder folder;
  std::ofstream(folder / "chart.csv") << csv_of(rows(), names);
  const auto read = rows_of_csv(folder / "chart.csv", names);
  EXPECT_EQ(csv_of(read, names), csv_of(rows(), names));
  EXPECT_EQ(read[1].setting, "10 kernels");
  EXPECT_TRUE(std::isnan(read[3].errors[0]));
  EXPECT_TRUE(rows_of_csv(folder / "chart.csv", {"natural"}).empty()) << "other columns";
}

TEST(ChartRows, ADamagedFileIsRefused) {
  const test::TemporaryFolder folder;
  const std::string text = csv_of(rows(), names);
  std::ofstream(folder / "cut.csv") << text.substr(0, text.size() - 12);
  EXPECT_THROW(rows_of_csv(folder / "cut.csv", names), FormatError);
  std::ofstream(folder / "bad.csv") << text.substr(0, text.find('\n') + 1) << "ours,default,5O,1,1,1,1,1,1\n";
  EXPECT_THROW(rows_of_csv(folder / "bad.csv", names), FormatError);
}

TEST(Verdicts, CompareOurDefaultWithTheBestOther) {
  const auto verdicts = verdicts_of(rows(), names);
  ASSERT_EQ(verdicts.size(), 3u);  // the column without any error is left out
  EXPECT_EQ(verdicts[0].best, "ours, default");
  EXPECT_TRUE(verdicts[0].ours_is_best());
  EXPECT_EQ(verdicts[1].best, "ours, 10 kernels");
  EXPECT_EQ(verdicts[1].rival, "ridge");
  EXPECT_FALSE(verdicts[1].ours_is_best()) << "the default setting is what counts";
  EXPECT_EQ(verdicts[2].images, 100);
  EXPECT_FALSE(verdicts[2].ours_is_best());
  EXPECT_NE(verdict_table(verdicts, 50).find("BEATS OURS"), std::string::npos);
}

TEST(Grid, LeavesOutSettingsThatNeedMoreImages) {
  const auto tasks = grid_of({"ours", "haar", "box"}, {10, 25}, {8, 20, 60});
  const auto count = [&](int images) {
    return std::ranges::count_if(tasks, [&](const Task& task) { return task.images == images; });
  };
  EXPECT_EQ(count(8), 2);   // ours by default, box
  EXPECT_EQ(count(20), 4);  // and 10 kernels of both
  EXPECT_EQ(count(60), 6);
  EXPECT_THROW(grid_of({"magic"}, {10}, {20}), InputError);
}

LightMap lit(const Box& box, float value, float elsewhere) {
  LightMap light{Image(16, 12, 3, elsewhere), Parameterisation::monitor};
  for (int y = box.y0; y < box.y1; ++y)
    for (int x = box.x0; x < box.x1; ++x)
      for (int c = 0; c < 3; ++c) light.radiance.at(x, y, c) = value;
  return light;
}

TEST(LightKind, IsSeenFromTheMap) {
  const float trace = 0x1p-15f;  // what a renderer may leave where light is off
  EXPECT_EQ(light_kind_of(lit({4, 0, 8, 12}, 1.0f, trace)), "bar");
  EXPECT_EQ(light_kind_of(lit({0, 4, 16, 6}, 0.5f, 0.0f)), "bar");
  EXPECT_EQ(light_kind_of(lit({4, 5, 8, 9}, 1.0f, trace)), "square");
  EXPECT_EQ(light_kind_of(lit({0, 0, 16, 12}, 1.0f, 0.0f)), "white");
  EXPECT_EQ(light_kind_of(lit({0, 0, 0, 0}, 1.0f, trace)), "black");
  EXPECT_EQ(light_kind_of(lit({4, 5, 8, 9}, 1.0f, 0.3f)), "natural");
  LightMap coloured = lit({4, 5, 8, 9}, 1.0f, 0.0f);
  coloured.radiance.at(5, 6, 1) = 0.5f;
  EXPECT_EQ(light_kind_of(coloured), "natural");
}

TEST(NoiseCurve, FollowsWhatPhotographsSayAboutThemselves) {
  const test::TemporaryFolder folder;
  Photograph photograph{Image(64, 64, 3), Image(64, 64, 3)};
  Rng rng(5);
  for (std::size_t i = 0; i < photograph.radiance.values.size(); ++i) {
    const double radiance = std::pow(2.0, rng.uniform(-8.0, 0.0));
    photograph.radiance.values[i] = static_cast<float>(radiance);
    photograph.sigma.values[i] = static_cast<float>(0.01 * std::sqrt(radiance));
  }
  photograph.sigma.values[3] = INFINITY;
  write_photograph(folder / "p.exr", photograph);
  const std::vector<CaptureFrame> frames = {{"p", FrameRole::train, "", {}, folder / "p.exr"}};
  const NoiseCurve curve(frames);
  ASSERT_TRUE(curve.known());
  for (const double radiance : {0.01, 0.1, 0.5})
    EXPECT_NEAR(curve.sigma(radiance), 0.01 * std::sqrt(radiance), 0.1 * 0.01 * std::sqrt(radiance));
  EXPECT_GT(curve.sigma(0.0), 0.0);
  EXPECT_EQ(curve.sigma(1e-9), curve.sigma(0.0));

  Image image(50, 50, 3, 0.25f);
  curve.add_to(image, rng);
  double squared = 0.0;
  for (const float value : image.values) squared += std::pow(value - 0.25, 2.0);
  EXPECT_NEAR(std::sqrt(squared / image.values.size()), 0.005, 0.0005);
}

TEST(DerivedKinds, TellTheShapeOfTransport) {
  const LightDomain domain{20, 20, Parameterisation::monitor};
  ReflectanceField field;
  field.width = 5;
  field.height = 3;
  field.basis = {domain, {}, {{0, 0, 20, 20}, {3, 3, 5, 5}, {0, 0, 14, 20}, {2, 2, 8, 8}}};
  const auto row = [&](std::vector<std::uint32_t> boxes, std::vector<float> weights) {
    std::vector<float> rgb;
    for (const float w : weights) rgb.insert(rgb.end(), 3, w);
    field.transfer.append_row(boxes, rgb);
  };
  // A column of the image each: wide, four texels, two thirds of the map, a peak on a base, nothing.
  for (int y = 0; y < 3; ++y) {
    row({0}, {1.0f});
    row({1}, {100.0f});
    row({2}, {1.0f});
    row({0, 3}, {1.0f, 12.0f});
    row({}, {});
  }
  EXPECT_NEAR(transport_spread(field, 1).half_area, 2.0 / 400, 1e-6);
  EXPECT_NEAR(transport_spread(field, 1).dark_area, 396.0 / 400, 1e-6);
  EXPECT_NEAR(transport_spread(field, 2).dark_area, 0.3, 1e-6);
  EXPECT_EQ(transport_spread(field, 4).light, 0.0);
  EXPECT_EQ(transport_spread(field, 0).half_area, 0.5);
  const PixelKinds kinds = derived_kinds(field, {});
  EXPECT_EQ(kinds.labels[5 + 4], 0);  // of no kind
  EXPECT_NE(kinds.labels[5 + 0], 0);
  // One column alone, so that the 3 × 3 medians see nothing else.
  const auto alone = [&](int column) {
    Mask mask(15, 0);
    for (int y = 0; y < 3; ++y) mask[static_cast<std::size_t>(5 * y + column)] = 1;
    const PixelKinds found = derived_kinds(field, mask);
    return found.names[static_cast<std::size_t>(found.labels[static_cast<std::size_t>(5 + column)] - 1)];
  };
  EXPECT_EQ(alone(0), "diffuse");
  EXPECT_EQ(alone(1), "refraction");
  EXPECT_EQ(alone(2), "hard_shadow");
  EXPECT_EQ(alone(3), "mixed");
}

}  // namespace
}  // namespace refield::chart
