// SPDX-License-Identifier: Apache-2.0
#include "estimate/rig/verdict.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace refield {
namespace {

using State = RigFinding::State;
using testing::HasSubstr;
using testing::IsEmpty;

const VerdictRow& row_of(const CaptureVerdict& verdict, const std::string& property) {
  const auto found = std::ranges::find(verdict.rows, property, &VerdictRow::property);
  if (found == verdict.rows.end()) throw std::out_of_range(property);
  return *found;
}

TEST(Verdict, OfACaptureThatObeysTheModelIsGood) {
  FrameReport report;
  report.typical_residual = 0.04;
  report.noise = 0.01;
  report.rig.findings = {{"pairing", State::good, 0.0, "as the photographs prefer", 0.04, 0.04},
                         {"motion", State::good, 0.0, "the camera rested", 0.04, 0.04}};
  const CaptureVerdict verdict = verdict_of(report, 120);
  EXPECT_EQ(verdict.state(), State::good);
  for (const VerdictRow& row : verdict.rows) EXPECT_THAT(row.remedy, IsEmpty()) << row.property;
  EXPECT_THAT(verdict_table(verdict), HasSubstr("check of 120 photographs: good"));
  EXPECT_THAT(unexplained_error(0.02, 0.01, std::nullopt, verdict), IsEmpty())
      << "what rectangles cannot represent";
}

TEST(Verdict, NamesWhatIsWrongAndWhatToDo) {
  FrameReport report;
  report.noise = 0.2;
  report.clipped_share = 0.001;
  report.left_out = {{"train_007", "41 times the usual residual", {}}};
  report.rig.findings = {
      {"motion", State::corrected, 0.3, "the picture moved steadily, by 0.30 pixels", 0.1, 0.04}};
  const CaptureVerdict verdict = verdict_of(report, 60);
  EXPECT_EQ(verdict.state(), State::suspicious);
  EXPECT_EQ(row_of(verdict, "motion").state, State::corrected);
  EXPECT_THAT(row_of(verdict, "motion").remedy, HasSubstr("fix the camera"));
  EXPECT_EQ(row_of(verdict, "clipping").state, State::suspicious);
  EXPECT_THAT(row_of(verdict, "clipping").measured, HasSubstr("0.1 %"));
  EXPECT_EQ(row_of(verdict, "noise").state, State::suspicious);
  EXPECT_THAT(row_of(verdict, "outlier frames").measured, HasSubstr("train_007"));
  EXPECT_THAT(verdict_table(verdict), HasSubstr("residual 0.100 to 0.040"));
  EXPECT_THAT(json_text(verdict_json(verdict)), HasSubstr("\"property\":\"motion\",\"state\":\"corrected\""));
}

TEST(Verdict, ClippingCountsFromTwoSamplesInTenThousand) {
  FrameReport report;
  for (const auto& [share, state] :
       {std::pair{1e-4, State::good}, {3e-4, State::suspicious}, {0.05, State::unusable}}) {
    report.clipped_share = share;
    EXPECT_EQ(row_of(verdict_of(report, 60), "clipping").state, state) << share;
  }
}

TEST(Verdict, AnErrorThatNoiseDoesNotExplainNamesTheLikelyCause) {
  FrameReport report;
  const std::string unknown = unexplained_error(0.5, 0.02, std::nullopt, verdict_of(report, 60));
  EXPECT_THAT(unknown, HasSubstr("training error of 50 %"));
  EXPECT_THAT(unknown, HasSubstr("each light map belongs to its photograph"));
  report.doubtful = {{"train_000", "differs", {}}, {"train_001", "differs", {}}};
  EXPECT_THAT(unexplained_error(0.5, 0.02, std::nullopt, verdict_of(report, 60)),
              HasSubstr("likely cause: outlier frames"));
  EXPECT_THAT(unexplained_error(0.2, 0.199, std::nullopt, verdict_of(report, 60)), IsEmpty())
      << "noise alone";
  EXPECT_THAT(unexplained_error(0.041, 0.025, 0.0025, verdict_of(report, 60)), IsEmpty())
      << "bright outliers";
  EXPECT_THAT(unexplained_error(0.041, 0.025, 0.015, verdict_of(report, 60)), HasSubstr("4.1 %"));
}

TEST(Verdict, AFindingThatWasNotCorrectedIsToldWhateverTheError) {
  FrameReport report;
  EXPECT_THAT(unexplained_error(0.012, 0.0, std::nullopt, verdict_of(report, 60)), IsEmpty());
  report.rig.findings = {{"tone", State::suspicious, 0.05, "exponents of 1.05", 0.1, 0.04}};
  EXPECT_THAT(unexplained_error(0.012, 0.0, std::nullopt, verdict_of(report, 60)),
              HasSubstr("not corrected: tone curve"));
}

}  // namespace
}  // namespace refield
