// SPDX-License-Identifier: Apache-2.0
#include "relight/held_out.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "core/base/errors.h"
#include "core/image/image_io.h"
#include "tests/support/random_data.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

constexpr LightDomain domain{12, 8, Parameterisation::monitor};
constexpr double rounding = 1e-5;

/// A session whose photographs are what `field_` gives, 10 % too bright for bars.
class HeldOut : public testing::Test {
 protected:
  HeldOut() {
    session_.folder = folder_.path();
    session_.light = domain;
    session_.width = field_.width;
    session_.height = field_.height;
    add_frame("n0", FrameRole::test, "natural", 1.0f);
    add_frame("b0", FrameRole::test, "bar", 1.1f);
    add_frame("n1", FrameRole::test, "natural", 1.0f);
    add_frame("t0", FrameRole::train, "natural", 50.0f);
  }

  void add_frame(const std::string& name, FrameRole role, const std::string& kind, float factor) {
    const LightMap light = test::random_light(rng_, domain);
    Photograph photograph{field_.relight(light), Image(field_.width, field_.height, 3, 0.01f)};
    for (float& value : photograph.radiance.values) value *= factor;
    CaptureFrame frame{name, role, kind, folder_ / (name + "_light.exr"), folder_ / (name + "_photo.exr")};
    write_exr(frame.illumination, light.radiance);
    write_photograph(frame.observed, photograph);
    session_.frames.push_back(frame);
  }

  test::TemporaryFolder folder_;
  Rng rng_{1};
  ReflectanceField field_ = test::random_field(rng_, 10, 6, domain, 30, 8);
  CaptureSession session_;
};

TEST_F(HeldOut, ErrorsByKindInOrderOfAppearance) {
  const auto errors = held_out_errors(field_, session_);
  ASSERT_EQ(errors.size(), 2u);
  EXPECT_EQ(errors[0].kind, "natural");
  EXPECT_EQ(errors[0].images, 2u);
  EXPECT_NEAR(errors[0].relative_rmse, 0.0, rounding);
  EXPECT_EQ(errors[1].kind, "bar");
  EXPECT_NEAR(errors[1].relative_rmse, 1.0 - 1.0 / 1.1, rounding);
  EXPECT_NEAR(errors[1].percentile_90, 1.0 - 1.0 / 1.1, rounding);
}

TEST_F(HeldOut, TruthStandsInForPhotographs) {
  for (const HeldOutError& error : held_out_errors(field_, session_, &field_))
    EXPECT_EQ(error.relative_rmse, 0.0) << error.kind;
}

TEST_F(HeldOut, SamplesThatWereNotMeasuredAreLeftOut) {
  Photograph photograph = read_photograph(session_.frames[0].observed);
  photograph.radiance.at(3, 3, 0) = 1e6f;
  photograph.sigma.at(3, 3, 0) = std::numeric_limits<float>::infinity();
  write_photograph(session_.frames[0].observed, photograph);
  EXPECT_NEAR(held_out_errors(field_, session_)[0].relative_rmse, 0.0, rounding);
}

TEST_F(HeldOut, RefusesWhatDoesNotFit) {
  CaptureSession empty = session_;
  std::erase_if(empty.frames, [](const CaptureFrame& frame) { return frame.role == FrameRole::test; });
  EXPECT_THROW(held_out_errors(field_, empty), InputError);
  CaptureSession larger = session_;
  larger.width = 11;
  EXPECT_THROW(held_out_errors(field_, larger), InputError);
}

TEST_F(HeldOut, ChecksPredictedErrors) {
  EXPECT_FALSE(held_out_errors(field_, session_)[0].prediction);
  // Photographs are 10 % too bright: every pixel of a bar is off by 1 − 1/1.1. The sessions's sigma is 0.01.
  const std::size_t pixels = static_cast<std::size_t>(field_.width) * field_.height;
  field_.quality.predicted_error.assign(pixels, 0.05f);
  field_.quality.photograph_noise.assign(pixels, 0.03f);  // 0.04 are the field's own
  const double actual = 1.0 - 1.0 / 1.1;
  const auto against_truth = [&] {
    ReflectanceField bright = field_;
    for (float& weight : bright.transfer.weight) weight *= 1.1f;
    return held_out_errors(field_, session_, &bright);
  };
  EXPECT_NEAR(against_truth()[1].prediction->median_ratio, 0.04 / actual, 1e-4);
  for (CaptureFrame& frame :
       session_.frames) {  // without sigma, noise is that of the training images, scaled
    Photograph photograph = read_photograph(frame.observed);
    photograph.sigma = {};
    write_photograph(frame.observed, photograph);
  }
  EXPECT_NEAR(held_out_errors(field_, session_)[1].prediction->median_ratio, 0.05 / actual, 1e-4);
  EXPECT_NEAR(
      held_out_errors(field_, session_, nullptr, FrameRole::test, 3.0)[1].prediction->predicted_median,
      std::sqrt(0.04 * 0.04 + 0.09 * 0.09), 1e-6);
}

}  // namespace
}  // namespace refield
