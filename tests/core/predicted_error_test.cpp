// SPDX-License-Identifier: Apache-2.0
#include "core/field/predicted_error.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/field/reflectance_field.h"

namespace refield {
namespace {

constexpr float leave_one_out = 1e-4f;
constexpr double rounding = 1e-6;

/// Every pixel has the same leave-one-out error; on the lattice cross-validation finds it `ratio(x)` times
/// as large, squared.
template <class Ratio>
ReflectanceField field_with(Ratio ratio, float shared = 0.0f) {
  ReflectanceField field;
  field.width = 360;
  field.height = 30;
  const CrossValidationLattice lattice(field.width, field.height);
  for (int y = 0; y < field.height; ++y)
    for (int x = 0; x < field.width; ++x) {
      ErrorEvidence evidence;
      evidence.leave_one_out = leave_one_out;
      evidence.shared = shared;
      if (lattice.holds(x, y)) evidence.cross_validated = leave_one_out * static_cast<float>(ratio(x));
      field.error_evidence.push_back(evidence);
    }
  predict_errors(field);
  return field;
}

TEST(PredictedError, LiesBetweenLeaveOneOutAndCrossValidation) {
  const auto field = field_with([](int) { return 4.0; });
  for (const float error : field.predicted_error)
    EXPECT_NEAR(error, std::sqrt(leave_one_out * (1.0 + 4.0) / 2.0), rounding);
}

TEST(PredictedError, CorrectsWhereTheLatticeSaysSo) {
  const auto field = field_with([](int x) { return x < 180 ? 1.0 : 9.0; });
  EXPECT_NEAR(field.predicted_error[15 * 360 + 5], 0.01, 2e-4);
  EXPECT_NEAR(field.predicted_error[15 * 360 + 355], std::sqrt(5e-4), 2e-4);
}

TEST(PredictedError, NoiseIsWhatNeighboursDoNotShare) {
  const auto field = field_with([](int) { return 1.0; }, 0.36f * leave_one_out);
  for (const float noise : field.photograph_noise) EXPECT_NEAR(noise, 0.8 * 0.01, rounding);
  // Chance may make the shared part negative, or larger than the whole.
  for (const float noise : field_with([](int) { return 1.0; }, -leave_one_out).photograph_noise)
    EXPECT_NEAR(noise, 0.01, rounding);
  for (const float noise : field_with([](int) { return 1.0; }, 2.0f * leave_one_out).photograph_noise)
    EXPECT_EQ(noise, 0.0f);
}

TEST(PredictedError, ASingleOddPixelIsSteadiedByItsNeighbours) {
  auto field = field_with([](int) { return 1.0; });
  const std::size_t odd = 10 * 360 + 60;
  field.error_evidence[odd].leave_one_out = 16.0f * leave_one_out;
  predict_errors(field);
  EXPECT_NEAR(field.predicted_error[odd], 0.02, 1e-3);  // √(0.04 · 0.01)
  EXPECT_NEAR(field.predicted_error[odd + 1], 0.01, rounding);
}

TEST(PredictedError, PixelsOutsideTheMaskStayEmpty) {
  auto field = field_with([](int) { return 2.0; });
  for (int x = 0; x < 360; ++x) field.error_evidence[7 * 360 + x] = {};
  predict_errors(field);
  EXPECT_EQ(field.predicted_error[7 * 360 + 50], 0.0f);
  EXPECT_NEAR(field.predicted_error[8 * 360 + 50], std::sqrt(1.5e-4), rounding);
}

TEST(PredictedError, LearningCurveTakesMiddleErrors) {
  auto field = field_with([](int) { return 2.0; });
  EXPECT_TRUE(field.learning_curve.empty());
  const CrossValidationLattice lattice(field.width, field.height);
  int row = 0;
  for (int y = 0; y < field.height; ++y)
    for (int x = 0; x < field.width; ++x)
      if (lattice.is_for_learning(x, y)) {
        ErrorEvidence& evidence = field.error_evidence[static_cast<std::size_t>(y) * field.width + x];
        ASSERT_TRUE(lattice.holds(x, y));
        evidence.from_half = row == 0 ? 1.0f : 9e-4f;  // few odd ones
        evidence.from_quarter = 16e-4f;
        row = (row + 1) % 5;
      }
  predict_errors(field);
  ASSERT_EQ(field.learning_curve.size(), 3u);
  EXPECT_EQ(field.learning_curve[0].share, 0.25f);
  EXPECT_NEAR(field.learning_curve[0].error, 0.04, rounding);
  EXPECT_NEAR(field.learning_curve[1].error, 0.03, rounding);
  EXPECT_NEAR(field.learning_curve[2].error, std::sqrt(2e-4), rounding);
}

TEST(PredictedError, WithoutALatticePointLeaveOneOutStands) {
  ReflectanceField field;
  field.width = field.height = 2;
  ErrorEvidence evidence;
  evidence.leave_one_out = leave_one_out;
  field.error_evidence.assign(4, evidence);
  predict_errors(field);
  for (const float error : field.predicted_error) EXPECT_NEAR(error, 0.01, rounding);
  field.error_evidence.clear();
  predict_errors(field);
  EXPECT_TRUE(field.predicted_error.empty());
}

}  // namespace
}  // namespace refield
