// SPDX-License-Identifier: Apache-2.0
// Brackets of a camera with a contrast curve: it is noticed, and estimated from the brackets themselves.
#include "acquire/import/bracket_merge.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "core/base/errors.h"
#include "core/base/rng.h"
#include "core/image/tone_map.h"
#include "tests/support/message_of.h"

namespace refield {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

using Curve = double (*)(double);  // share of full light to share of full scale

double srgb(double light) {
  return srgb_from_linear(static_cast<float>(light));
}
/// sRGB, then the S of a camera's standard picture style: darks darker, brights brighter.
double contrast(double light) {
  const double x = srgb(light);
  return x + 0.12 * std::sin(2.0 * M_PI * (x - 0.5)) * 4.0 * x * (1.0 - x);
}

/// A picture style that acts as a power of the light: all exposures differ by one factor.
double steep(double light) {
  return std::pow(srgb(light), 1.25);
}

constexpr int width = 240, height = 160;

/// Radiance over three decades, smooth from place to place, as a scene under a natural pattern.
Image scene(std::uint64_t seed) {
  Rng random(seed);
  Image image(width, height, 3);
  const double a = random.uniform(0.0, 6.0), b = random.uniform(0.0, 6.0);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int c = 0; c < 3; ++c)
        image.at(x, y, c) = static_cast<float>(
            8.0 * std::exp(-3.3 + 2.4 * std::sin(0.025 * x + a + 0.3 * c) * std::cos(0.035 * y + b) +
                           random.uniform(-0.05, 0.05)));
  return image;
}

/// `noise`: of the levels, as JPEG's compression adds.
BracketFile exposed(const Image& radiance, double seconds, Curve curve, Rng& random, double noise = 0.0) {
  constexpr double electrons = 20000.0, read_noise = 6.0;
  BracketFile file;
  file.bits = 8;
  file.exposure = Seconds(seconds);
  file.frame.width = radiance.width;
  file.frame.height = radiance.height;
  file.frame.layout = PixelLayout::rgb;
  for (const float r : radiance.values) {
    const double mean = electrons * r * seconds;
    const double light = (mean + std::hypot(std::sqrt(mean), read_noise) * random.normal()) / electrons;
    const double level = 255.0 * curve(std::clamp(light, 0.0, 1.0)) + noise * random.normal();
    file.frame.samples.push_back(static_cast<std::uint16_t>(std::lround(std::clamp(level, 0.0, 255.0))));
  }
  return file;
}

Bracket bracket_of(const Image& radiance, const std::vector<double>& times, Curve curve, double noise = 0.0) {
  Rng random(7);
  Bracket bracket;
  for (const double seconds : times) {
    bracket.paths.emplace_back("shot_" + std::to_string(bracket.paths.size()) + ".jpg");
    bracket.files.push_back(exposed(radiance, seconds, curve, random, noise));
    bracket.exposures.emplace_back(seconds);
  }
  return bracket;
}

const std::vector<double> times = {1.0 / 60.0, 1.0 / 15.0, 1.0 / 4.0};

/// Relative RMS error of the merged radiance, up to the factor that fits best.
double error_of(const Image& truth, const BracketCamera& camera, Curve curve) {
  Bracket bracket = bracket_of(truth, times, curve);
  const Photograph merged = merge_bracket(bracket, camera);
  double rt = 0.0, rr = 0.0, tt = 0.0;
  for (std::size_t i = 0; i < truth.values.size(); ++i) {
    if (!std::isfinite(merged.sigma.values[i])) continue;
    const double r = merged.radiance.values[i], t = truth.values[i];
    rt += r * t;
    rr += r * r;
    tt += t * t;
  }
  return std::sqrt(1.0 - rt * rt / (rr * tt));
}

std::vector<BracketSamples> brackets(Curve curve) {
  std::vector<BracketSamples> list;
  for (const std::uint64_t seed : {1, 2, 3})
    list.push_back(samples_of(bracket_of(scene(seed), times, curve)));
  return list;
}

TEST(BracketResponse, AContrastCurveIsNoticedAndEstimated) {
  BracketCamera camera;
  const auto notes = settle_response(brackets(contrast), camera);
  ASSERT_EQ(notes.size(), 1U);
  EXPECT_THAT(notes[0],
              AllOf(HasSubstr("contradict the sRGB curve by"), HasSubstr("estimated from 3 brackets")));
  const Image fresh = scene(9);  // not among the brackets that the curve comes from
  const double before = error_of(fresh, BracketCamera{}, contrast), after = error_of(fresh, camera, contrast);
  RecordProperty("before", std::to_string(before));
  RecordProperty("after", std::to_string(after));
  EXPECT_GT(before, 0.10);
  constexpr double like_a_known_curve = 0.02;
  EXPECT_LT(after, like_a_known_curve);
  EXPECT_LT(after, 1.3 * error_of(fresh, BracketCamera{}, srgb) + 0.005);
}

TEST(BracketResponse, ACurveThatActsAsAPowerIsEstimated) {
  BracketCamera camera;
  const auto notes = settle_response(brackets(steep), camera);
  ASSERT_EQ(notes.size(), 1U);
  EXPECT_THAT(notes[0], AllOf(HasSubstr("times as bright"), HasSubstr("estimated from 3 brackets")));
  const Image fresh = scene(9);
  EXPECT_GT(error_of(fresh, BracketCamera{}, steep), 0.10);
  EXPECT_LT(error_of(fresh, camera, steep), 0.02);
}

TEST(BracketResponse, ClippedSamplesBesideEdgesAreNoMeasurement) {
  // Levels of a clipped highlight in a JPEG file: its compression moves some below 255.
  Bracket bracket = bracket_of(scene(1), times, srgb);
  const std::array<std::uint16_t, 3> ringing = {247, 255, 236};
  for (std::size_t i = 0; i < 3; ++i) bracket.files[i].frame.samples[600] = ringing[i];
  EXPECT_TRUE(std::isinf(merge_bracket(bracket, {}).sigma.values[600]));
}

TEST(BracketResponse, NoiseOfCompressionDoesNotBendTheCurve) {
  constexpr double noise = 4.0;
  std::vector<BracketSamples> noisy;
  for (const std::uint64_t seed : {1, 2, 3, 4, 5})
    noisy.push_back(samples_of(bracket_of(scene(seed), times, contrast, noise)));
  BracketCamera camera;
  EXPECT_THAT(settle_response(noisy, camera), ::testing::ElementsAre(HasSubstr("estimated from 5 brackets")));
  ASSERT_EQ(camera.curve.size(), 256U);
  // The scale is free: both are compared with a light of 0.2.
  const auto estimated = [&](double light) {
    return camera.curve[static_cast<std::size_t>(std::lround(255.0 * contrast(light)))] / light;
  };
  for (const double light : {0.02, 0.05, 0.1, 0.4, 0.7, 0.9})
    EXPECT_NEAR(estimated(light) / estimated(0.2), 1.0, 0.06) << "light " << light;
}

TEST(BracketResponse, ACameraWithTheSrgbCurveIsLeftAlone) {
  BracketCamera camera;
  EXPECT_THAT(settle_response(brackets(srgb), camera), IsEmpty());
  EXPECT_TRUE(camera.curve.empty());
  const ExposureAgreement agreement = compare_exposures(brackets(srgb)[0], camera);
  EXPECT_GT(agreement.compared, 1000U);
  EXPECT_LT(agreement.spread, 0.02);
  EXPECT_NEAR(agreement.factor, 1.0, 0.03);
}

TEST(BracketResponse, AGivenResponseIsKeptAndDoubted) {
  BracketCamera camera;
  camera.response = "gamma:1.2";
  const auto notes = settle_response(brackets(srgb), camera);
  ASSERT_EQ(notes.size(), 1U);
  EXPECT_THAT(notes[0], AllOf(HasSubstr("contradict 'gamma:1.2'"), HasSubstr("camera.toml")));
  EXPECT_TRUE(camera.curve.empty());
}

TEST(BracketResponse, SwappedTimesAndOneFileTwiceAreRefused) {
  const BracketCamera camera;
  Bracket swapped = bracket_of(scene(1), times, srgb);
  std::swap(swapped.exposures[0], swapped.exposures[2]);
  EXPECT_THAT(test::message_of([&] { merge_bracket(swapped, camera); }),
              AllOf(HasSubstr("shot_1.jpg: is darker than shot_2.jpg"), HasSubstr("swapped")));
  Bracket twice = bracket_of(scene(1), {times[0], times[1]}, srgb);
  twice.files[1] = twice.files[0];
  EXPECT_THAT(
      test::message_of([&] { merge_bracket(twice, camera); }),
      HasSubstr("shot_1.jpg: is no brighter than shot_0.jpg, though its exposure time is 0.0666667 s"));
  Bracket linear;  // float files
  for (const double seconds : {0.1, 0.4}) {
    BracketFile file;
    file.linear = scene(1);
    for (float& value : file.linear.values) value *= static_cast<float>(0.5 - seconds);
    linear.files.push_back(std::move(file));
    linear.paths.emplace_back("shot.exr");
    linear.exposures.emplace_back(seconds);
  }
  EXPECT_THAT(test::message_of([&] { merge_bracket(linear, camera); }), HasSubstr("darker"));
}

TEST(BracketResponse, AWrongRatioOfTimesIsNoted) {
  Bracket bracket = bracket_of(scene(1), times, srgb);
  for (std::size_t i = 0; i < 3; ++i)
    bracket.exposures[i] = Seconds(std::pow(2.0, static_cast<double>(i)) / 60.0);
  BracketCamera camera;
  camera.response = "srgb";
  const auto notes = settle_response(std::vector{samples_of(bracket)}, camera);
  ASSERT_EQ(notes.size(), 1U);
  EXPECT_THAT(notes[0], AllOf(HasSubstr("was exposed 2 times as long"), HasSubstr("times as bright")));
}

TEST(BracketResponse, AWrongStepOfBracketingIsNotTakenForACurve) {
  Bracket bracket = bracket_of(scene(1), times, srgb);
  for (std::size_t i = 0; i < 3; ++i)
    bracket.exposures[i] = Seconds(std::pow(2.0, static_cast<double>(i)) / 60.0);
  BracketCamera camera;
  const auto notes = settle_response(std::vector{samples_of(bracket)}, camera);
  ASSERT_EQ(notes.size(), 1U);
  EXPECT_THAT(notes[0], HasSubstr("check --exposures"));
  EXPECT_TRUE(camera.curve.empty());
}

TEST(BracketResponse, OneExposureOfEightBitsIsWarnedOf) {
  BracketCamera camera;
  const auto notes = settle_response(std::vector{samples_of(bracket_of(scene(1), {0.1}, contrast))}, camera);
  ASSERT_EQ(notes.size(), 1U);
  EXPECT_THAT(notes[0], HasSubstr("cannot confirm"));
  camera.response = "srgb";
  EXPECT_THAT(settle_response(std::vector{samples_of(bracket_of(scene(1), {0.1}, srgb))}, camera), IsEmpty());
}

/// Brackets of five scenes whose files state `times`, whatever they are.
std::vector<BracketSamples> stated(const std::vector<double>& seconds, Curve curve, double noise) {
  std::vector<BracketSamples> brackets;
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    brackets.push_back(samples_of(bracket_of(scene(seed), seconds, curve, noise)));
    brackets.back().seconds = times;
  }
  return brackets;
}

TEST(MeasuredTimes, ExactTimesStay) {
  for (const Curve curve : {srgb, contrast}) {
    const auto brackets = stated(times, curve, 1.0);
    BracketCamera camera;
    settle_response(brackets, camera);
    EXPECT_EQ(settle_times(brackets, camera), "");
    EXPECT_THAT(camera.measured_times, IsEmpty());
  }
}

TEST(MeasuredTimes, RoundedTimesAreFoundWhereExposuresOverlap) {
  const std::vector<double> meant = {std::exp2(-6), std::exp2(-4), std::exp2(-2)};
  for (const Curve curve : {srgb, contrast}) {
    const auto brackets = stated(meant, curve, 1.0);
    BracketCamera camera;
    settle_response(brackets, camera);
    EXPECT_THAT(settle_times(brackets, camera), HasSubstr("0.01667, 0.06667, 0.25 s"));
    ASSERT_EQ(camera.measured_times.size(), 3U);
    const auto ratio = [&](std::size_t i) {
      return camera.measured_times[i + 1].second / camera.measured_times[i].second;
    };
    constexpr double rounding = 0.03;  // of 8 bits; the stated times have 3.75
    EXPECT_NEAR(ratio(0), 4.0, rounding);
    EXPECT_NEAR(ratio(1), 4.0, rounding);
  }
}

TEST(MeasuredTimes, SmallPicturesAreEnoughForRoundedTimesUnderAContrastCurve) {
  std::vector<BracketSamples> brackets = stated({std::exp2(-6), std::exp2(-4), std::exp2(-2)}, contrast, 1.0);
  for (BracketSamples& bracket : brackets)  // too few for classes of brightness in each bracket
    for (auto& exposure : bracket.values) {
      for (std::size_t k = 0; 8 * k < exposure.size(); ++k) exposure[k] = exposure[8 * k];
      exposure.resize((exposure.size() + 7) / 8);
    }
  BracketCamera camera;
  settle_response(brackets, camera);
  ASSERT_FALSE(camera.curve.empty());
  EXPECT_THAT(settle_times(brackets, camera), HasSubstr("0.01562, 0.0625, 0.25 s"));
}

}  // namespace
}  // namespace refield
