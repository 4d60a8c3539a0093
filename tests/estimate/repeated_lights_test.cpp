// SPDX-License-Identifier: Apache-2.0
// Lights that repeat, or are multiples of one another: one fold, wherever images are left out.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <mutex>
#include <numeric>
#include <string>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/rng.h"
#include "core/image/image_io.h"
#include "core/image/metrics.h"
#include "core/light/summed_area_table.h"
#include "estimate/estimate.h"
#include "estimate/fit/light_groups.h"
#include "estimate/quality/error_evidence.h"
#include "estimate/quality/error_follower.h"
#include "estimate/quality/outlier_frames.h"
#include "tests/support/message_of.h"
#include "tests/support/synthetic_capture.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

using ::testing::HasSubstr;

std::vector<int> groups_of(const std::vector<LightMap>& lights) {
  std::vector<LightSketch> sketches;
  for (const LightMap& light : lights) sketches.push_back(sketch_of(light.radiance));
  return light_groups(sketches);
}

std::vector<int> numbers_to(int count) {
  std::vector<int> numbers(count);
  std::iota(numbers.begin(), numbers.end(), 0);
  return numbers;
}

LightMap scaled(LightMap light, float red, float green, float blue) {
  for (std::size_t i = 0; i < light.radiance.values.size(); ++i)
    light.radiance.values[i] *= i % 3 == 0 ? red : i % 3 == 1 ? green : blue;
  return light;
}

/// All lights, then all again at each of the factors.
std::vector<LightMap> shown_again(const std::vector<LightMap>& lights, const std::vector<float>& factors) {
  std::vector<LightMap> all = lights;
  for (const float factor : factors)
    for (const LightMap& light : lights) all.push_back(scaled(light, factor, factor, factor));
  return all;
}

TEST(LightGroups, MultiplesAndRepeatsAreOne) {
  const auto lights = test::random_lights(12, 32, 24, 1);
  EXPECT_EQ(groups_of(lights), numbers_to(12));
  std::vector<int> expected = numbers_to(12);
  for (int copy = 0; copy < 2; ++copy)
    for (int j = 0; j < 12; ++j) expected.push_back(j);
  EXPECT_EQ(groups_of(shown_again(lights, {1.0f, 0.25f})), expected);
}

TEST(LightGroups, MeasuredCopiesAre) {
  auto lights = shown_again(test::random_lights(12, 32, 24, 1), {0.25f});
  Rng rng(3);
  for (std::size_t j = 12; j < lights.size(); ++j)  // as levels of 8 bits, or a photograph of a ball
    for (float& value : lights[j].radiance.values) value *= 1.0f + 0.02f * static_cast<float>(rng.normal());
  EXPECT_EQ(count_of(groups_of(lights)), 12);
}

TEST(LightGroups, OnePatternInSeveralColoursIs) {
  const auto patterns = test::random_lights(6, 32, 24, 1);
  std::vector<LightMap> lights;
  for (const LightMap& pattern : patterns) {
    lights.push_back(scaled(pattern, 1.0f, 0.0f, 0.0f));
    lights.push_back(scaled(pattern, 0.0f, 1.0f, 0.0f));
  }
  EXPECT_EQ(count_of(groups_of(lights)), 12) << "red and green tell nothing of one another";
  for (const LightMap& pattern : patterns) lights.push_back(pattern);
  EXPECT_EQ(count_of(groups_of(lights)), 6);
}

TEST(LightGroups, LightsThatDifferAreNot) {
  const int width = 64, height = 48;
  std::vector<LightMap> checks, single, on_bright_ground;
  for (int j = 0; j < 12; ++j) {
    LightMap light{Image(width, height, 3), Parameterisation::monitor};
    Rng rng(static_cast<std::uint64_t>(j));
    for (int y = 0; y < height; y += 2)
      for (int x = 0; x < width; x += 2) {
        const auto diagonal =
            static_cast<int>(rng.below(2));  // two of four texels, so that all have one coarse sum
        for (int c = 0; c < 3; ++c)
          light.radiance.at(x + diagonal, y, c) = light.radiance.at(x + 1 - diagonal, y + 1, c) = 1.0f;
      }
    checks.push_back(light);
  }
  for (int j = 0; j < 300; ++j) {
    LightMap light{Image(width, height, 3), Parameterisation::monitor};
    for (int c = 0; c < 3; ++c) light.radiance.at(7 * j % width, j / 8, c) = 1.0f;
    single.push_back(light);
  }
  for (const LightMap& light : test::random_lights(20, width, height, 2)) {
    on_bright_ground.push_back(light);
    for (float& value : on_bright_ground.back().radiance.values) value = 1.0f + 0.02f * value;
  }
  EXPECT_EQ(groups_of(checks), numbers_to(12));
  EXPECT_EQ(count_of(groups_of(single)), 300);
  EXPECT_EQ(groups_of(on_bright_ground), numbers_to(20));
}

TEST(LightGroups, RankCountsIndependentLights) {
  std::vector<LightMap> lights = test::random_lights(6, 32, 24, 1);
  for (int j = 0; j < 6; ++j) {
    LightMap sum = lights[j];
    for (std::size_t i = 0; i < sum.radiance.values.size(); ++i)
      sum.radiance.values[i] += lights[(j + 1) % 6].radiance.values[i];
    lights.push_back(sum);
  }
  std::vector<LightSketch> sketches;
  for (const LightMap& light : lights) sketches.push_back(sketch_of(light.radiance));
  EXPECT_EQ(count_of(light_groups(sketches)), 12);
  EXPECT_EQ(light_rank(sketches), 6);
}

/// A pixel of three boxes and noise under some lights, and under all of these again at 1 and 1/4.
class RepeatedLights : public ::testing::Test {
 protected:
  static constexpr int lights = 20;
  struct Pixel {
    std::vector<LightMap> maps;
    BoxTable table{maps};
    AlignedFloats values = AlignedFloats(3 * table.stride());
    PixelSamples samples() const {
      return {values.data(), values.data() + table.stride(), values.data() + 2 * table.stride()};
    }
  };
  static EstimateOptions fast() {
    EstimateOptions options;
    options.mode = EstimateMode::fast;
    options.kernels = 10;
    return options;
  }
  /// Photographs of a light are multiples of one, noise included, so that they tell as much as one.
  Pixel pixel(const std::vector<float>& factors) const {
    Pixel pixel{shown_again(base_, factors)};
    Rng rng(8);
    for (int c = 0; c < 3; ++c)
      for (int j = 0; j < lights; ++j) {
        const SummedAreaTable sums(base_[j].radiance);
        double b = 0.0;
        for (const Box& box : boxes_) b += sums.sum(box)[c];
        b *= 1.0 + 0.05 * rng.normal();
        float* values = pixel.values.data() + c * pixel.table.stride();
        values[j] = static_cast<float>(b);
        for (std::size_t k = 0; k < factors.size(); ++k)
          values[(k + 1) * lights + j] = factors[k] * static_cast<float>(b);
      }
    return pixel;
  }
  std::vector<float> left_out(Pixel& pixel) const {
    const SmoothSpace none(pixel.table);
    KernelCache cache(pixel.table, none, EstimateMode::fast);
    MaskedSamples masked;
    masked.assign(pixel.samples(), pixel.table.stride(), pixel.table.images());
    const PixelKernels kernels =
        WeightFitter(pixel.table).fit(prepare_kernel_set(boxes_, cache), masked, std::vector<float>(9, 1.0f));
    AlignedFloats residuals(3 * pixel.table.stride());
    ErrorEvaluator(pixel.table, fast()).leave_one_out(kernels, cache, masked, residuals.data());
    return {residuals.begin(), residuals.begin() + pixel.table.images()};
  }

  const std::vector<Box> boxes_ = {{0, 0, 8, 6}, {8, 6, 12, 9}, {4, 0, 8, 12}};
  const std::vector<LightMap> base_ = test::random_lights(lights, 16, 12, 5);
};

TEST_F(RepeatedLights, LeaveOneOutIsThatOfEachLightOnce) {
  Pixel once = pixel({}), again = pixel({1.0f, 0.25f});
  const auto expected = left_out(once), found = left_out(again);
  constexpr float float32_sums = 2e-3f;  // of 1 − h, where h is near 1
  for (int j = 0; j < lights; ++j) {
    EXPECT_NEAR(found[j] / expected[j], 1.0f, float32_sums) << j;
    EXPECT_NEAR(found[lights + j] / expected[j], 1.0f, float32_sums) << j;
    EXPECT_NEAR(found[2 * lights + j] / expected[j], 0.25f, float32_sums) << j;
  }
}

TEST_F(RepeatedLights, CrossValidationIsThatOfEachLightOnce) {
  Pixel once = pixel({}), again = pixel({1.0f, 0.25f});
  const PixelSamples one[] = {once.samples()}, all[] = {again.samples()};
  const double expected = ErrorEvaluator(once.table, fast()).cross_validate(one, 1)[0] * (2.0 + 1.0 / 16.0);
  const double found = ErrorEvaluator(again.table, fast()).cross_validate(all, 1)[0];
  EXPECT_NEAR(found / expected, 1.0, 0.02);  // splits of equal gain
}

TEST_F(RepeatedLights, TheErrorUnderALightDoesNotDependOnCopies) {
  const LightErrorModel once = light_error_model(BoxTable(base_), {});
  const LightErrorModel again = light_error_model(BoxTable(shown_again(base_, {1.0f})), {});
  for (const LightMap& light : test::random_lights(5, 16, 12, 77))
    // Two photographs of a light leave half the noise.
    EXPECT_NEAR(again.variances_under(light.radiance)[0] / once.variances_under(light.radiance)[0], 1.0, 0.1);
}

TEST_F(RepeatedLights, FramesAreComparedWithThoseOfOtherLights) {
  // One kernel matrix, three series; frames 0, 4 and 7 show one light, and 7 and 9 are left out.
  const int images = 12;
  Rng rng(5);
  Eigen::MatrixXd features(images, 30);
  for (auto& value : features.reshaped()) value = rng.normal();
  features.row(4) = 0.25 * features.row(0);
  features.row(7) = features.row(0);
  const Eigen::MatrixXd gram = features * features.transpose() / 30.0;
  Eigen::MatrixXf series(images, 3);
  for (auto& value : series.reshaped()) value = static_cast<float>(rng.normal());
  std::vector<char> out(images, 0);
  out[7] = out[9] = 1;
  const std::vector<std::vector<int>> repeats = {{0, 4, 7}};
  const LeaveOneOut found = leave_one_out({gram}, series, out, repeats);
  double nearest = 1.0;
  for (const double ridge : {1e-5, 1e-4, 1e-3, 1e-2}) {  // one of them is chosen for each series
    double worst = 0.0;
    for (int j = 0; j < images; ++j) {
      std::vector<Eigen::Index> others;
      for (int k = 0; k < images; ++k) {
        const bool same_light =
            std::ranges::count(repeats[0], j) > 0 && std::ranges::count(repeats[0], k) > 0;
        if (k != j && !out[k] && !same_light) others.push_back(k);
      }
      const Eigen::VectorXd weights = ridge_inverse(gram(others, others), ridge) * gram(others, j);
      const double residual = series(j, 0) - weights.dot(series(others, 0).cast<double>());
      worst = std::max(worst, std::abs(residual - found.residual(j, 0)) / (1.0 + std::abs(residual)));
    }
    nearest = std::min(nearest, worst);
  }
  EXPECT_LT(nearest, 1e-3);
}

TEST_F(RepeatedLights, UnmeasuredSamplesOfLeftOutFramesChangeNothing) {
  const int images = 10;
  Rng rng(6);
  Eigen::MatrixXd features(images, 30);
  for (auto& value : features.reshaped()) value = rng.normal();
  const Eigen::MatrixXd gram = features * features.transpose() / 30.0;
  Eigen::MatrixXf series(images, 1);
  for (auto& value : series.reshaped()) value = static_cast<float>(rng.normal());
  series(2, 0) = std::numeric_limits<float>::quiet_NaN();
  std::vector<char> out(images, 0);
  out[8] = 1;
  const LeaveOneOut measured = leave_one_out({gram}, series, out, {});
  series(8, 0) = std::numeric_limits<float>::quiet_NaN();
  const LeaveOneOut unmeasured = leave_one_out({gram}, series, out, {});
  for (int j = 0; j < 8; ++j) EXPECT_FLOAT_EQ(measured.residual(j, 0), unmeasured.residual(j, 0)) << j;
  EXPECT_EQ(unmeasured.residual(8, 0), 0.0f);
}

/// Captures whose lights repeat, estimated.
class RepeatedCapture : public ::testing::Test {
 protected:
  static constexpr double noise = 0.02;
  RepeatedCapture()
      : truth_(test::field_of_boxes(24, 20, {16, 12, Parameterisation::monitor},
                                    {{0, 0, 8, 6}, {8, 6, 12, 9}, {4, 0, 8, 12}, {1, 7, 3, 11}}, 9)) {}

  CaptureSession capture(int lights, const std::vector<float>& factors) const {
    return test::write_capture(folder_ / "session", truth_,
                               shown_again(test::random_lights(lights, 16, 12, 3), factors), noise);
  }
  ReflectanceField estimated(const CaptureSession& session, EstimateOptions options = {}) {
    notes_.clear();
    options.keep_rig = true;
    RunContext run;
    run.on_note = [this](const std::string& note) { notes_ += note + "\n"; };
    return estimate_field(session, options, run);
  }
  /// Predicted by true error on new photographs as noisy, over the picture.
  double ratio(const ReflectanceField& field) const {
    double predicted = 0.0;
    for (const float error : field.quality.predicted_error) predicted += error * error;
    SeriesError series;
    for (const LightMap& light : test::random_lights(20, 16, 12, 99))
      series.add(field.relight(light), truth_.relight(light));
    return std::sqrt(predicted / static_cast<double>(field.quality.predicted_error.size())) /
           std::hypot(series.relative_rmse(), noise);
  }

  const test::TemporaryFolder folder_;
  ReflectanceField truth_;
  std::string notes_;
};

TEST_F(RepeatedCapture, PredictedErrorIsThatOfNewLights) {
  for (const std::vector<float>& factors : {std::vector<float>{}, {1.0f}, {0.25f}, {1.0f, 0.25f, 0.25f}}) {
    const double found = ratio(estimated(capture(30, factors)));
    EXPECT_GT(found, 0.8) << factors.size() + 1 << " times";
    EXPECT_LT(found, 1.25) << factors.size() + 1 << " times";
    EXPECT_EQ(notes_, "");
  }
}

TEST_F(RepeatedCapture, FewLightsPredictNothingHoweverOftenTheyAreShown) {
  const auto field = estimated(capture(5, {1.0f, 0.25f, 0.25f}));
  for (const float error : field.quality.predicted_error) EXPECT_EQ(error, 0.0f);
  EXPECT_THAT(notes_, HasSubstr("only 5 of the 20 light maps differ"));
  ErrorFollower follower(EstimateOptions{});
  for (const CaptureFrame& frame : capture(5, {1.0f, 0.25f}).frames)
    follower.add(frame, Parameterisation::monitor);
  const FollowedError followed = follower.predict();
  EXPECT_EQ(followed.images, 15);
  EXPECT_EQ(followed.lights, 5);
  EXPECT_FALSE(followed.predicted);
}

TEST_F(RepeatedCapture, SumsOfFewLightsAreNamed) {
  std::vector<LightMap> lights = test::random_lights(8, 16, 12, 3);
  for (int j = 0; j < 8; ++j) {
    LightMap sum = lights[j];
    for (std::size_t i = 0; i < sum.radiance.values.size(); ++i)
      sum.radiance.values[i] += lights[(j + 3) % 8].radiance.values[i];
    lights.push_back(sum);
  }
  estimated(test::write_capture(folder_ / "session", truth_, lights, noise));
  EXPECT_THAT(notes_, HasSubstr("the 16 light maps that differ are sums of 8"));
}

TEST_F(RepeatedCapture, GoodFramesStayWhereSomeLightsRepeat) {
  // Half of the lights twice: frames without a copy are no outliers because others have one.
  auto lights = test::random_lights(30, 16, 12, 3);
  for (int j = 0; j < 15; ++j) lights.push_back(lights[j]);
  estimated(test::write_capture(folder_ / "session", truth_, lights, noise));
  EXPECT_EQ(notes_, "");
}

TEST_F(RepeatedCapture, AFlickerAmongCopiesIsFound) {
  const CaptureSession session = capture(20, {1.0f, 1.0f});
  Photograph photograph = read_photograph(session.frames[25].observed);
  for (float& value : photograph.radiance.values) value *= 1.5f;
  write_photograph(session.frames[25].observed, photograph);
  estimated(session);
  EXPECT_THAT(notes_, HasSubstr(session.frames[25].name + " is left out"));
}

TEST_F(RepeatedCapture, AChannelWithoutSamplesIsRefused) {
  const CaptureSession session = capture(30, {});
  for (const bool everywhere : {false, true}) {
    for (const CaptureFrame& frame : session.frames) {
      Photograph photograph = read_photograph(frame.observed);
      photograph.sigma = Image(24, 20, 3, 0.01f);
      for (int y = 0; y < 20; ++y)
        for (int x = 0; x < (everywhere ? 24 : 8); ++x)
          photograph.sigma.at(x, y, 2) = std::numeric_limits<float>::infinity();
      write_photograph(frame.observed, photograph);
    }
    if (everywhere) {
      EXPECT_THAT(test::message_of([&] { estimated(session); }), HasSubstr("measured the blue channel"));
    } else {
      const auto field = estimated(session);
      EXPECT_THAT(notes_, HasSubstr("of the pixels have a channel that no photograph measured"));
      EXPECT_EQ(field.quality.predicted_error[4], 0.0f) << "not known";
      EXPECT_GT(field.quality.predicted_error[20], 0.0f);
    }
  }
}

TEST_F(RepeatedCapture, KernelsLimitsTheRegressionOnCells) {
  const auto lights = test::random_lights(40, 8, 6, 3);  // 48 texels
  const auto truth = test::field_of_boxes(12, 8, lights[0].domain(), {{0, 0, 4, 3}, {2, 1, 6, 5}}, 9);
  const auto session = test::write_capture(folder_ / "session", truth, lights, noise);
  EstimateOptions options;
  options.kernels = 3;
  const auto field = estimated(session, options);
  for (std::size_t p = 0; p < field.transfer.rows(); ++p)
    EXPECT_LE(field.transfer.row_start[p + 1] - field.transfer.row_start[p], 3u) << p;
}

}  // namespace
}  // namespace refield
