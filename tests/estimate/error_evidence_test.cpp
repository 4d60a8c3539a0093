// SPDX-License-Identifier: Apache-2.0
#include "estimate/quality/error_evidence.h"
#include "core/base/linear_algebra.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <limits>

#include "core/base/rng.h"
#include "core/light/summed_area_table.h"
#include "estimate/estimate.h"
#include "estimate/fit/refit.h"
#include "tests/support/synthetic_capture.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

constexpr int images = 40;
constexpr double float32_sums = 1e-4;  // relative, of residuals of a few per cent

/// One pixel that three boxes and 5 % noise make.
class ErrorEvidenceOfAPixel : public ::testing::Test {
 protected:
  ErrorEvidenceOfAPixel()
      : lights_(test::random_lights(images, 16, 12, 5)),
        table_(lights_),
        none_(table_),
        cache_(table_, none_, EstimateMode::fast),
        values_(3 * table_.stride()) {
    Rng rng(8);
    for (int c = 0; c < 3; ++c)
      for (int j = 0; j < images; ++j) {
        const SummedAreaTable sums(lights_[j].radiance);
        double b = 0.0;
        for (const Box& box : boxes_) b += sums.sum(box)[c];
        values_[c * table_.stride() + j] = static_cast<float>(b * (1.0 + 0.05 * rng.normal()));
      }
  }
  PixelSamples samples() const {
    return {values_.data(), values_.data() + table_.stride(), values_.data() + 2 * table_.stride()};
  }

  /// Leave-one-out by doing it: least squares anew without each image.
  double slow_leave_one_out(const KernelSet& set) const {
    const auto kernels = static_cast<Eigen::Index>(set.boxes.size());
    double squared = 0.0;
    for (int c = 0; c < 3; ++c)
      for (int out = 0; out < images; ++out) {
        const float* b = samples()[c];
        if (std::isnan(b[out])) continue;
        Eigen::MatrixXd A = Eigen::MatrixXd::Zero(images, kernels);
        Eigen::VectorXd y = Eigen::VectorXd::Zero(images);
        double predicted = 0.0;
        for (int j = 0; j < images; ++j) {
          if (j == out || std::isnan(b[j])) continue;
          y[j] = b[j];
          for (Eigen::Index k = 0; k < kernels; ++k) A(j, k) = set.columns[c][k][j];
        }
        const Eigen::VectorXd x = solve_least_squares(A, y);
        for (Eigen::Index k = 0; k < kernels; ++k) predicted += x[k] * set.columns[c][k][out];
        squared += (b[out] - predicted) * (b[out] - predicted);
      }
    return squared;
  }

  static EstimateOptions fast() {
    EstimateOptions options;
    options.mode = EstimateMode::fast;
    options.kernels = 10;
    return options;
  }

  double fast_leave_one_out(const KernelSet& set) {
    MaskedSamples masked;
    masked.assign(samples(), table_.stride(), images);
    const std::vector<float> ones(9, 1.0f);
    const PixelKernels kernels = WeightFitter(table_).fit(set, masked, ones);
    EXPECT_EQ(kernels.boxes.size(), 3u);
    AlignedFloats residuals(3 * table_.stride());
    return ErrorEvaluator(table_, fast()).leave_one_out(kernels, cache_, masked, residuals.data());
  }

  const std::vector<Box> boxes_ = {{0, 0, 8, 6}, {8, 6, 12, 9}, {4, 0, 8, 12}};
  std::vector<LightMap> lights_;
  BoxTable table_;
  SmoothSpace none_;
  KernelCache cache_;
  AlignedFloats values_;
};

TEST_F(ErrorEvidenceOfAPixel, LeaveOneOutEqualsLeavingOneOut) {
  const KernelSet set = prepare_kernel_set(boxes_, cache_);
  const double slow = slow_leave_one_out(set);
  EXPECT_NEAR(fast_leave_one_out(set) / slow, 1.0, float32_sums);
}

TEST_F(ErrorEvidenceOfAPixel, UnmeasuredSamplesAreLeftOut) {
  for (const int j : {3, 17, 18}) values_[table_.stride() + j] = std::numeric_limits<float>::quiet_NaN();
  const KernelSet set = prepare_kernel_set(boxes_, cache_);
  const double slow = slow_leave_one_out(set);
  EXPECT_NEAR(fast_leave_one_out(set) / slow, 1.0, float32_sums);
}

TEST_F(ErrorEvidenceOfAPixel, CrossValidationExceedsTheNoiseAndTheTrainingError) {
  const PixelKernels all = PixelFitter(cache_, fast()).fit(samples());
  const PixelSamples block[] = {samples()};
  const double cross_validated = ErrorEvaluator(table_, fast()).cross_validate(block, 1)[0];
  EXPECT_GT(cross_validated, all.squared_residual);
  const double noise = 0.05 * 0.05 * all.squared_samples;
  EXPECT_GT(cross_validated, 0.8 * noise);
  EXPECT_LT(cross_validated, 4.0 * noise);
}

TEST(PredictedErrorOfAField, PredictsTheErrorOnNewLights) {
  const test::TemporaryFolder folder;
  const auto lights = test::random_lights(60, 16, 12, 3);
  const auto truth = test::field_of_boxes(23, 18, lights[0].domain(),
                                          {{0, 0, 8, 6}, {8, 6, 12, 9}, {4, 0, 8, 12}, {1, 7, 3, 11}}, 9);
  const auto session = test::write_capture(folder / "session", truth, lights, 0.03);
  EstimateOptions options;
  const auto field = estimate_field(session, options);
  ASSERT_EQ(field.quality.predicted_error.size(), field.transfer.rows());

  double predicted = 0.0, noise = 0.0, own = 0.0, signal = 0.0;
  for (const LightMap& light : test::random_lights(20, 16, 12, 99)) {
    const Image estimated = field.relight(light);
    const Image exact = truth.relight(light);
    for (std::size_t i = 0; i < exact.values.size(); ++i) {
      own += std::pow(estimated.values[i] - exact.values[i], 2.0);
      signal += std::pow(exact.values[i], 2.0);
    }
  }
  for (std::size_t p = 0; p < field.quality.predicted_error.size(); ++p) {
    predicted += std::pow(field.quality.predicted_error[p], 2.0) / field.quality.predicted_error.size();
    noise += std::pow(field.quality.photograph_noise[p], 2.0) / field.quality.predicted_error.size();
  }
  const double actual = std::sqrt(own / signal + 0.03 * 0.03);  // on photographs as noisy
  EXPECT_NEAR(std::sqrt(predicted) / actual, 1.0, 0.2);
  EXPECT_NEAR(std::sqrt(noise) / 0.03, 1.0, 0.2);

  options.predict_errors = false;
  const auto without = estimate_field(session, options);
  EXPECT_TRUE(without.quality.predicted_error.empty());
  EXPECT_EQ(without.transfer.weight, field.transfer.weight);
}

/// Noise that differs between the halves of a picture, which brightness does not tell.
TEST(PredictedErrorOfAField, NoiseIsWhatPhotographsState) {
  const auto lights = test::random_lights(60, 64, 48, 3);
  const auto truth = test::field_of_boxes(24, 18, lights[0].domain(), {{0, 0, 32, 24}, {32, 24, 48, 36}}, 9);
  const auto noise_of = [](int x) { return x < 12 ? 0.01f : 0.04f; };
  std::vector<Image> photographs, sigmas;
  Rng rng(5);
  for (const LightMap& light : lights) {
    Image& photograph = photographs.emplace_back(truth.relight(light));
    Image& sigma = sigmas.emplace_back(photograph);
    for (std::size_t i = 0; i < sigma.values.size(); ++i) {
      sigma.values[i] *= noise_of(static_cast<int>(i / 3) % photograph.width);
      photograph.values[i] += sigma.values[i] * static_cast<float>(rng.normal());
    }
  }
  const std::vector<LightMapView> light_views(lights.begin(), lights.end());
  const std::vector<ImageView> views(photographs.begin(), photographs.end());
  const std::vector<ImageView> sigma_views(sigmas.begin(), sigmas.end());
  const auto field = estimate(light_views, views, sigma_views, {}, {});
  double ratio = 0.0;
  for (std::size_t p = 0; p < field.quality.photograph_noise.size(); ++p)
    ratio += field.quality.photograph_noise[p] / noise_of(static_cast<int>(p) % field.width) /
             static_cast<double>(field.quality.photograph_noise.size());
  EXPECT_NEAR(ratio, 1.0, 0.1);
}

TEST(LightErrorModel, BarsLeaveMoreErrorThanTrainingLights) {
  const int width = 32, height = 16;
  const auto lights = test::random_lights(images, width, height, 5);
  const LightErrorModel model = light_error_model(BoxTable(lights), {});
  const auto others = test::random_lights(images, width, height, 6);
  double same_kind = 0.0, energy = 0.0;
  const auto energy_of = [](const Image& light) {
    double sum = 0.0;
    for (const float v : light.values) sum += v;
    return sum * sum;
  };
  for (const LightMap& light : others) {
    same_kind += model.variances_under(light.radiance)[0] / images;
    energy += energy_of(light.radiance) / images;
  }
  EXPECT_GT(same_kind, 0.5);  // 1 by its definition for the mean of training lights that are left out
  EXPECT_LT(same_kind, 2.0);
  Image bar(width, height, 3);
  for (int y = 0; y < height; ++y)
    for (int c = 0; c < 3; ++c) bar.at(7, y, c) = 1.0f;
  EXPECT_GT(model.variances_under(bar)[0] / energy_of(bar), 2.0 * same_kind / energy);
  Image doubled = bar;
  for (float& v : doubled.values) v *= 2.0f;
  EXPECT_NEAR(model.variances_under(doubled)[0], 4.0 * model.variances_under(bar)[0],
              1e-9 * model.variances_under(doubled)[0]);
}

}  // namespace
}  // namespace refield
