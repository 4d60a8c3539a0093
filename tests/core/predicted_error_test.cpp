// SPDX-License-Identifier: Apache-2.0
#include "core/field/predicted_error.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <utility>

#include "core/field/reflectance_field.h"

namespace refield {
namespace {

constexpr float leave_one_out = 1e-4f;
constexpr double rounding = 1e-6;
constexpr float many = 1e12f;  // samples, which leave nothing to chance

struct Predicted {
  FieldOutline field;
  std::vector<ErrorEvidence> evidence;

  const FieldQuality& quality() const { return field.quality; }
  void predict() { predict_errors(field, evidence); }
};

/// Every pixel has the same leave-one-out error; on the lattice cross-validation finds it `ratio(x)` times
/// as large, squared.
template <class Ratio>
Predicted field_with(Ratio ratio, float noise = std::numeric_limits<float>::quiet_NaN()) {
  Predicted predicted;
  FieldOutline& field = predicted.field;
  field.width = 360;
  field.height = 30;
  const CrossValidationLattice lattice(field.width, field.height);
  for (int y = 0; y < field.height; ++y)
    for (int x = 0; x < field.width; ++x) {
      ErrorEvidence evidence;
      evidence.leave_one_out = leave_one_out;
      evidence.noise = noise;
      evidence.samples = many;
      if (lattice.holds(x, y)) evidence.cross_validated = leave_one_out * static_cast<float>(ratio(x));
      predicted.evidence.push_back(evidence);
    }
  predicted.predict();
  return predicted;
}

TEST(PredictedError, IsThatOfCrossValidationWithAFifthMoreImages) {
  const auto predicted = field_with([](int) { return 4.0; }, 0.25f * leave_one_out);
  for (const float error : predicted.quality().predicted_error)
    EXPECT_NEAR(error, std::sqrt(leave_one_out * (0.25 + std::pow(0.8, 1.5) * 3.75)), rounding);
}

TEST(PredictedError, IsHalfTheWayUnderLightWithFewDegreesOfFreedom) {
  auto predicted = field_with([](int) { return 4.0; });
  for (ErrorEvidence& pixel : predicted.evidence) pixel.expected = 1e-5f;
  predicted.predict();
  for (const float error : predicted.quality().predicted_error)
    EXPECT_NEAR(error, std::sqrt(leave_one_out * (1.0 + 4.0) / 2.0), rounding);
}

TEST(PredictedError, CorrectsWhereTheLatticeSaysSo) {
  const auto predicted = field_with([](int x) { return x < 180 ? 1.0 : 9.0; });
  EXPECT_NEAR(predicted.quality().predicted_error[15 * 360 + 5], 0.01, 2e-4);
  EXPECT_NEAR(predicted.quality().predicted_error[15 * 360 + 355],
              std::sqrt(1e-4 + std::pow(0.8, 1.5) * 8e-4), 2e-4);
}

TEST(PredictedError, TheRegressionCountsUnlessImagesShowFarLess) {
  auto predicted = field_with([](int) { return 1.0; });
  for (const auto& [expected, error] : {std::pair(3e-4f, 3e-4), std::pair(1e-2f, 1e-4)}) {
    for (ErrorEvidence& pixel : predicted.evidence) pixel.expected = expected;
    predicted.predict();
    EXPECT_NEAR(predicted.quality().predicted_error[15], std::sqrt(error), rounding);
  }
}

TEST(PredictedError, NoiseIsWhatTheBestPixelsLeave) {
  auto predicted = field_with([](int) { return 1.0; });
  for (std::size_t p = 0; p < predicted.evidence.size(); p += 10)
    predicted.evidence[p].leave_one_out = 0.36f * leave_one_out;
  predicted.predict();
  EXPECT_NEAR(predicted.quality().photograph_noise[15], 0.6 * 0.01, rounding);
  // Of few samples the best pixels have low errors by chance: 0.36 is not below what noise of 1 leaves.
  for (ErrorEvidence& pixel : predicted.evidence) pixel.samples = 10.0f;
  predicted.predict();
  EXPECT_NEAR(predicted.quality().photograph_noise[15], std::sqrt(0.36 / 0.5) * 0.01, rounding);
}

TEST(PredictedError, NoiseIsThatOfPixelsOfEqualBrightness) {
  auto predicted = field_with([](int) { return 1.0; });
  for (std::size_t p = 0; p < predicted.evidence.size(); ++p) {
    const bool is_dark = p % 360 < 180;
    predicted.field.quality.training_signal.push_back(is_dark ? 0.1f : 1.0f);
    predicted.evidence[p].leave_one_out = (is_dark ? 4.0f : p % 3 == 0 ? 1.0f : 2.0f) * leave_one_out;
    predicted.evidence[p].cross_validated = std::numeric_limits<float>::quiet_NaN();
  }
  predicted.predict();
  EXPECT_NEAR(predicted.quality().photograph_noise[15 * 360 + 5], 0.02, rounding);
  EXPECT_NEAR(predicted.quality().photograph_noise[15 * 360 + 355], 0.01, rounding);
}

TEST(PredictedError, StatedNoiseIsTakenUnlessTheErrorIsLess) {
  const auto stated = field_with([](int) { return 1.0; }, 0.36f * leave_one_out);
  for (const float noise : stated.quality().photograph_noise) EXPECT_NEAR(noise, 0.6 * 0.01, rounding);
  auto above = field_with([](int) { return 1.0; }, 2.0f * leave_one_out);
  for (std::size_t p = 0; p < above.evidence.size(); ++p)
    if (p % 10 != 0) above.evidence[p].leave_one_out = 4.0f * leave_one_out;
  above.predict();
  EXPECT_NEAR(above.quality().photograph_noise[15], std::sqrt(1.1) * 0.01, rounding);
}

TEST(PredictedError, ErrorOfNoisyPixelsIsSpreadMoreOverTheLight) {
  for (const auto& [noise, expected] : {std::pair(3.6e-5f, 0u), {2e-4f, 1u}, {9e-4f, 2u}, {1e-2f, 3u}}) {
    auto predicted = field_with([](int) { return 4.0; }, noise);
    for (ErrorEvidence& pixel : predicted.evidence) pixel.leave_one_out = 2.0f * noise;
    LightErrorModel& model = predicted.field.quality.light_error;
    model.cells = {{0, 0, 1, 1}};
    model.directions = {1.0f};
    model.variances.assign(light_noise_ratios.size(), 1.0f);
    predicted.predict();
    EXPECT_EQ(predicted.quality().light_class[15], expected) << noise;
  }
}

TEST(PredictedError, ASingleOddPixelIsSteadiedByItsNeighbours) {
  auto predicted = field_with([](int) { return 1.0; });
  const std::size_t odd = 10 * 360 + 60;
  predicted.evidence[odd].leave_one_out = 16.0f * leave_one_out;
  predicted.predict();
  EXPECT_NEAR(predicted.quality().predicted_error[odd], 0.02, 1e-3);  // √(0.04 · 0.01)
  EXPECT_NEAR(predicted.quality().predicted_error[odd + 1], 0.01, rounding);
}

TEST(PredictedError, PixelsOutsideTheMaskStayEmpty) {
  auto predicted = field_with([](int) { return 2.0; });
  for (int x = 0; x < 360; ++x) predicted.evidence[7 * 360 + x] = {};
  predicted.predict();
  EXPECT_EQ(predicted.quality().predicted_error[7 * 360 + 50], 0.0f);
  EXPECT_NEAR(predicted.quality().predicted_error[8 * 360 + 50], std::sqrt(1e-4 + std::pow(0.8, 1.5) * 1e-4),
              rounding);
}

TEST(PredictedError, LearningCurveTakesMiddleErrorsOfManyPixels) {
  auto predicted = field_with([](int) { return 2.0; });
  EXPECT_TRUE(predicted.quality().learning_curve.empty());
  for (int x = 8; x < 12; ++x) predicted.evidence[8 * 360 + x].from_half = 9e-4f;
  for (int x = 8; x < 12; ++x) predicted.evidence[8 * 360 + x].from_quarter = 16e-4f;
  predicted.predict();
  EXPECT_TRUE(predicted.quality().learning_curve.empty()) << "four pixels are not the picture";
  const CrossValidationLattice lattice(predicted.field.width, predicted.field.height);
  int row = 0;
  for (int y = 0; y < predicted.field.height; ++y)
    for (int x = 0; x < predicted.field.width; ++x)
      if (lattice.is_for_learning(x, y)) {
        ErrorEvidence& evidence = predicted.evidence[static_cast<std::size_t>(y) * predicted.field.width + x];
        ASSERT_TRUE(lattice.holds(x, y));
        evidence.from_half = row == 0 ? 1.0f : 9e-4f;  // few odd ones
        evidence.from_quarter = 16e-4f;
        row = (row + 1) % 5;
      }
  predicted.predict();
  ASSERT_EQ(predicted.quality().learning_curve.size(), 3u);
  EXPECT_EQ(predicted.quality().learning_curve[0].share, 0.25f);
  EXPECT_NEAR(predicted.quality().learning_curve[0].error, 0.04, rounding);
  EXPECT_NEAR(predicted.quality().learning_curve[1].error, 0.03, rounding);
  EXPECT_NEAR(predicted.quality().learning_curve[2].error, std::sqrt(2e-4), rounding);
}

TEST(PredictedError, WithoutALatticePointLeaveOneOutStands) {
  Predicted predicted;
  predicted.field.width = predicted.field.height = 2;
  ErrorEvidence evidence;
  evidence.leave_one_out = leave_one_out;
  predicted.evidence.assign(4, evidence);
  predicted.predict();
  for (const float error : predicted.quality().predicted_error) EXPECT_NEAR(error, 0.01, rounding);
  predicted.evidence.clear();
  predicted.predict();
  EXPECT_TRUE(predicted.quality().predicted_error.empty());
}

}  // namespace
}  // namespace refield
