// SPDX-License-Identifier: Apache-2.0
#include "core/field/predicted_error.h"

#include <gmock/gmock.h>

#include <cmath>

namespace refield {
namespace {

using testing::HasSubstr;

std::vector<LearningPoint> points_of(double noise, double scale, double exponent) {
  std::vector<LearningPoint> points;
  for (const double share : {0.25, 0.5, 0.8})
    points.push_back({static_cast<float>(share),
                      static_cast<float>(std::sqrt(noise * noise + scale * std::pow(share, -exponent)))});
  return points;
}

TEST(LearningCurve, GoesThroughPointsOfItsOwnShape) {
  const LearningCurve curve(points_of(0.01, 2e-4, 1.3), 0.01);
  ASSERT_TRUE(curve.known());
  EXPECT_NEAR(curve.error_at(1.0), std::sqrt(3e-4), 1e-6);
  EXPECT_NEAR(curve.error_at(2.0), std::sqrt(1e-4 + 2e-4 * std::pow(2.0, -1.3)), 1e-6);
  EXPECT_NEAR(curve.error_at(1e9), 0.01, 1e-5);
}

TEST(LearningCurve, SaysWhetherMoreImagesHelp) {
  EXPECT_THAT(LearningCurve(points_of(0.001, 2e-4, 1.0), 0.001).advice(), HasSubstr("would help: twice"));
  const std::string noisy = LearningCurve(points_of(0.02, 1e-5, 1.0), 0.02).advice();
  EXPECT_THAT(noisy, HasSubstr("hardly help"));
  EXPECT_THAT(noisy, HasSubstr("photograph noise"));
}

TEST(LearningCurve, NeverRisesWithMoreImages) {
  const std::vector<LearningPoint> rising = {{0.25f, 0.01f}, {0.5f, 0.012f}, {0.8f, 0.013f}};
  const LearningCurve curve(rising, 0.0);
  EXPECT_LE(curve.error_at(2.0), curve.error_at(1.0));
}

TEST(LearningCurve, NoiseAboveTheErrorIsNoHarm) {
  const LearningCurve curve(points_of(0.01, 1e-5, 1.0), 0.05);
  EXPECT_GT(curve.error_at(2.0), 0.0);
  EXPECT_LE(curve.error_at(2.0), curve.error_at(0.25));
}

TEST(LearningCurve, NeedsTwoDifferentShares) {
  EXPECT_FALSE(LearningCurve({}, 0.0).known());
  const std::vector<LearningPoint> same = {{0.5f, 0.1f}, {0.5f, 0.2f}};
  EXPECT_FALSE(LearningCurve(same, 0.0).known());
  EXPECT_EQ(LearningCurve(same, 0.0).advice(), "");
}

}  // namespace
}  // namespace refield
