// SPDX-License-Identifier: Apache-2.0
#include "relight/relight.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <filesystem>
#include <functional>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/image/image_io.h"
#include "tests/support/mesh_field.h"
#include "tests/support/message_of.h"
#include "tests/support/random_data.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

constexpr LightDomain domain{24, 16, Parameterisation::monitor};

class Relight : public testing::Test {
 protected:
  Rng rng_{1};
  ReflectanceField field_ = test::random_field(rng_, 30, 20, domain, 80, 25);
};

void expect_near(const Image& found, const std::function<double(std::size_t)>& expected) {
  constexpr double float_rounding = 1e-5;  // 25 terms, each rounded a few times
  for (std::size_t i = 0; i < found.values.size(); ++i)
    ASSERT_NEAR(found.values[i], expected(i), float_rounding * std::max(1.0, std::abs(expected(i)))) << i;
}

// The slow reference: every kernel's texels are summed one by one (Matusik et al. 2004, eqs. 3 and 4).
TEST_F(Relight, EqualsTheSumOverTexels) {
  const LightMap light = test::random_light(rng_, domain);
  const auto texel_sum = [&](const Box& box, int c) {
    double sum = 0.0;
    for (int y = box.y0; y < box.y1; ++y)
      for (int x = box.x0; x < box.x1; ++x) sum += light.radiance.at(x, y, c);
    return sum;
  };
  expect_near(field_.relight(light), [&](std::size_t i) {
    const std::size_t pixel = i / 3;
    double sum = 0.0;
    for (auto e = field_.transfer.row_start[pixel]; e < field_.transfer.row_start[pixel + 1]; ++e)
      sum += field_.transfer.weight[3 * e + i % 3] *
             texel_sum(field_.basis.boxes[field_.transfer.column[e]], static_cast<int>(i % 3));
    return sum;
  });
}

TEST_F(Relight, IsLinearInTheLight) {
  const LightMap a = test::random_light(rng_, domain);
  const LightMap b = test::random_light(rng_, domain);
  LightMap mixed = a;
  for (std::size_t i = 0; i < mixed.radiance.values.size(); ++i)
    mixed.radiance.values[i] = 2.0f * a.radiance.values[i] + 0.5f * b.radiance.values[i];
  const Image image_a = field_.relight(a);
  const Image image_b = field_.relight(b);
  expect_near(field_.relight(mixed),
              [&](std::size_t i) { return 2.0 * image_a.values[i] + 0.5 * image_b.values[i]; });
}

TEST_F(Relight, DarknessGivesBlackAndLightNothingNegative) {
  const Image black = field_.relight({Image(domain.width, domain.height, 3), domain.parameterisation});
  EXPECT_TRUE(std::ranges::all_of(black.values, [](float v) { return v == 0.0f; }));
  const Image lit = field_.relight(test::random_light(rng_, domain));
  EXPECT_TRUE(std::ranges::all_of(lit.values, [](float v) { return v >= 0.0f; }));
}

TEST_F(Relight, ChannelsDoNotMix) {
  LightMap red = test::random_light(rng_, domain);
  for (std::size_t i = 0; i < red.radiance.values.size(); ++i)
    if (i % 3 != 0) red.radiance.values[i] = 0.0f;
  const Image image = field_.relight(red);
  for (std::size_t i = 0; i < image.values.size(); ++i) {
    if (i % 3 != 0) {
      EXPECT_EQ(image.values[i], 0.0f);
    }
  }
}

TEST_F(Relight, FilesHoldWhatTheFieldGives) {
  const test::TemporaryFolder folder;
  std::vector<RelightJob> jobs;
  std::vector<LightMap> lights;
  for (int i = 0; i < 5; ++i) {
    lights.push_back(test::random_light(rng_, domain));
    jobs.push_back({[light = lights.back()] { return light; }, folder / (std::to_string(i) + ".exr")});
  }
  jobs.push_back({[light = lights[0]] { return light; }, folder / "0.png"});
  relight_to_files(field_, jobs);
  for (int i = 0; i < 5; ++i)
    EXPECT_EQ(read_image(folder / (std::to_string(i) + ".exr")).values, field_.relight(lights[i]).values);
  EXPECT_EQ(read_image(folder / "0.png").width, field_.width);
}

TEST_F(Relight, ReportsTheLightThatTheFieldDoesNotKnow) {
  const test::TemporaryFolder folder;
  LightMap left{Image(domain.width, domain.height, 3), domain.parameterisation};
  LightMap whole = left;
  for (int y = 0; y < domain.height; ++y)
    for (int x = 0; x < domain.width; ++x)
      for (int c = 0; c < 3; ++c) {
        whole.radiance.at(x, y, c) = 1.0f;
        if (x == 0) left.radiance.at(x, y, c) = 1.0f;
      }
  const std::vector<RelightJob> known = {{[=] { return left; }, folder / "left.exr"}};
  const std::vector<RelightJob> both = {known[0], {[=] { return whole; }, folder / "whole.exr"}};
  EXPECT_EQ(relight_to_files(field_, both).light_shares.unobserved, 0.0) << "where nothing is stated";
  field_.observed_light = {{0, 0, 1, domain.height}};
  EXPECT_NEAR(relight_to_files(field_, known).light_shares.unobserved, 0.0, 1e-12);
  EXPECT_NEAR(relight_to_files(field_, both).light_shares.unobserved, 1.0 - 1.0 / domain.width, 1e-12);
}

TEST_F(Relight, MeshesAreLitOnceAndReportTheirLight) {
  const test::TemporaryFolder folder;
  Mesh triangle;
  triangle.positions = {{0.0f, 0.0f, 0.0f}, {1.0f, 0.0f, 0.0f}, {0.0f, 1.0f, 0.0f}};
  triangle.normals.assign(3, Eigen::Vector3f(0.0f, 0.0f, -1.0f));
  triangle.colours.assign(3, Eigen::Array3f::Ones());
  triangle.triangles = {{0, 1, 2}};
  ReflectanceField field = test::unshadowed_field(triangle);
  field.observed_light = {{0, 0, 4, 4}};  // one face of six
  std::atomic<int> lights = 0;
  const LightFunction white = [&] {
    ++lights;
    return LightMap{Image(4, 24, 3, 1.0f), Parameterisation::cube};
  };
  const std::vector<RelightJob> jobs = {{white, folder / "0.glb"}, {white, folder / "1.glb"}};
  const ExposureReport report = relight_to_files(field, jobs, {.is_sequence = true});
  EXPECT_EQ(lights, 2);
  EXPECT_NEAR(report.light_shares.unobserved, 5.0 / 6.0, 1e-6);
  EXPECT_EQ(read_text(folder / "0.glb"), read_text(folder / "1.glb"));
}

TEST_F(Relight, PicturesAreExposedByThemselvesAndSequencesAsOne) {
  const test::TemporaryFolder folder;
  std::vector<RelightJob> jobs;
  for (int i = 0; i < 20; ++i) {
    LightMap light = test::random_light(rng_, domain);
    for (float& value : light.radiance.values) value *= std::exp2(static_cast<float>(i - 10));
    jobs.push_back({[light] { return light; }, folder / (std::to_string(i) + ".png")});
  }
  const auto brightest = [&](int i) {
    const Image image = read_image(folder / (std::to_string(i) + ".png"));
    return *std::ranges::max_element(image.values);
  };
  const ExposureReport each = relight_to_files(field_, jobs);
  ASSERT_EQ(each.factors.size(), 20u);
  EXPECT_NEAR(each.factors[0] / each.factors[19], std::exp2(19.0), 0.2 * std::exp2(19.0));
  for (const int i : {0, 7, 19}) EXPECT_EQ(brightest(i), 1.0f) << i;
  const std::string own = read_text(folder / "7.png");
  relight_to_files(field_, jobs, {.factor = each.factors[7]});
  EXPECT_EQ(read_text(folder / "7.png"), own);

  const ExposureReport shared = relight_to_files(field_, jobs, {.is_sequence = true});
  ASSERT_EQ(shared.factors.size(), 1u);
  EXPECT_LT(brightest(0), 0.05f) << "neither the first frame decides";
  EXPECT_EQ(brightest(19), 1.0f);
  EXPECT_LT(shared.factors[0], 20.0 * each.factors[19]);
  EXPECT_GT(shared.factors[0], 0.5 * each.factors[19]);
  EXPECT_GT(relight_to_files(field_, jobs, {.factor = 1e9}).clipped, 0.9);
  jobs.resize(3);
  for (RelightJob& job : jobs) job.output.replace_extension(".exr");
  EXPECT_TRUE(relight_to_files(field_, jobs).factors.empty());
}

TEST_F(Relight, ALightTooBrightForFloatsIsRefused) {
  const test::TemporaryFolder folder;
  LightMap light = test::random_light(rng_, domain);
  std::ranges::fill(light.radiance.values, 3e38f);
  EXPECT_THAT(test::message_of<InputError>([&] {
                relight_to_files(field_, {{[&] { return light; }, folder / "a.exr"}});
              }),
              testing::AllOf(testing::HasSubstr("a.exr"), testing::HasSubstr("3e+38")));
  EXPECT_FALSE(std::filesystem::exists(folder / "a.exr"));
}

TEST_F(Relight, RefusesOtherFormatsBeforeAnyWork) {
  const test::TemporaryFolder folder;
  bool asked = false;
  const auto light = [&] {
    asked = true;
    return test::random_light(rng_, domain);
  };
  EXPECT_THROW(relight_to_files(field_, {{light, folder / "a.exr"}, {light, folder / "a.jpg"}}), InputError);
  EXPECT_FALSE(asked);
}

TEST_F(Relight, ALightOfTheWrongSizeIsNamedAndNothingIsWritten) {
  const test::TemporaryFolder folder;
  const auto light = [] { return LightMap{Image(3, 3, 3), Parameterisation::monitor}; };
  EXPECT_THROW(relight_to_files(field_, {{light, folder / "a.exr"}}), InputError);
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

}  // namespace
}  // namespace refield
