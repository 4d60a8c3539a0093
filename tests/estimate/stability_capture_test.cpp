// SPDX-License-Identifier: Apache-2.0
// Captures that say little or say it badly: few images, lights that are alike, noise, clipping, a sun, odd
// sizes of the light map, colours that mix.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/base/rng.h"
#include "core/image/image_io.h"
#include "core/image/metrics.h"
#include "estimate/estimate.h"
#include "tests/support/series_error.h"
#include "tests/support/stability.h"
#include "tests/support/synthetic_capture.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

/// The field is never worse than the better baseline by more than this factor.
constexpr double worst_against_baselines = 1.25;

std::string percent(double share) {
  return std::to_string(static_cast<int>(std::lround(100.0 * share))) + " %";
}

EstimateOptions options_without_checks() {
  EstimateOptions options;
  options.keep_outliers = true;  // what is odd here is not single frames
  options.predict_errors = false;
  return options;
}

/// Captures, estimates, records, and holds the error against the baselines. Returns it.
double stable_error(const test::StabilityScene& scene, const std::vector<LightMap>& lights, double noise,
                    const std::string& condition, const std::string& setting, double undisturbed) {
  const test::TemporaryFolder folder;
  const auto session = test::write_capture(folder / "session", scene.truth, lights, noise);
  const double found = scene.error(estimate_field(session, options_without_checks()));
  const double constant = scene.error_of_constant(session);
  const double ridge = scene.error_of_ridge(session);
  test::record_figure({condition, setting, found, undisturbed, constant, ridge});
  EXPECT_TRUE(std::isfinite(found));
  EXPECT_LE(found, worst_against_baselines * std::min(constant, ridge)) << condition << ", " << setting;
  return found;
}

double undisturbed_error(const test::StabilityScene& scene) {
  const test::TemporaryFolder folder;
  return scene.error(estimate_field(test::write_capture(folder / "session", scene.truth, scene.lights, 0.01),
                                    options_without_checks()));
}

TEST(PoorCapture, FewImagesGiveALessSharpFieldNotAWildOne) {
  const test::StabilityScene scene;
  const double undisturbed = undisturbed_error(scene);
  double before = 0.0;
  for (const int count : {80, 40, 20, 10, 5}) {
    const std::vector<LightMap> few(scene.lights.begin(), scene.lights.begin() + count);
    const double found =
        stable_error(scene, few, 0.01, "few images", std::to_string(count) + " images", undisturbed);
    EXPECT_GE(found, 0.5 * before) << "fewer images should not be better";
    before = found;
  }
}

TEST(PoorCapture, LightsThatAreAlikeCountAsFewer) {
  const test::StabilityScene scene;
  const double undisturbed = undisturbed_error(scene);
  for (const double own : {0.3, 0.03}) {
    // Ten lights, each eight times with a little of another.
    std::vector<LightMap> lights = scene.lights;
    for (std::size_t j = 0; j < lights.size(); ++j)
      for (std::size_t i = 0; i < lights[j].radiance.values.size(); ++i)
        lights[j].radiance.values[i] = static_cast<float>(
            (1.0 - own) * scene.lights[j % 10].radiance.values[i] + own * scene.lights[j].radiance.values[i]);
    stable_error(scene, lights, 0.01, "lights that are alike",
                 "10 lights 8 times, " + percent(own) + " their own", undisturbed);
  }
}

TEST(PoorCapture, ErrorGrowsNoFasterThanNoise) {
  const test::StabilityScene scene;
  const double undisturbed = undisturbed_error(scene);
  for (const double noise : {0.0, 0.01, 0.02, 0.05}) {
    const double found = stable_error(scene, scene.lights, noise, "noise", percent(noise), undisturbed);
    EXPECT_LE(found, std::max(noise, 0.01)) << "worse than a single photograph";
  }
}

/// A capture with 1 % noise, and ten times as much in every third photograph.
struct UnequalCapture {
  explicit UnequalCapture(std::uint64_t seed = 11)
      : scene(80, seed), session(test::write_capture(folder / "session", scene.truth, scene.lights, 0.01)) {
    for (std::size_t j = 0; j < session.frames.size(); j += 3) {
      const Image exact = scene.truth.relight(scene.lights[j]);
      test::change_photograph(session.frames[j], [&](Image& image) {
        for (std::size_t i = 0; i < image.values.size(); ++i)
          image.values[i] = static_cast<float>(std::lerp(exact.values[i], image.values[i], 10.0));
      });
    }
  }
  double error() const { return scene.error(estimate_field(session, options_without_checks())); }

  const test::TemporaryFolder folder;
  const test::StabilityScene scene;
  CaptureSession session;
};

TEST(UnequalNoise, NoisyPhotographsDoNoHarm) {
  double all = 0.0, good = 0.0;
  for (const std::uint64_t seed : {11, 12, 13}) {
    UnequalCapture capture(seed);
    all += capture.error();
    std::vector<CaptureFrame> frames;
    for (std::size_t j = 0; j < capture.session.frames.size(); ++j)
      if (j % 3 != 0) frames.push_back(capture.session.frames[j]);
    capture.session.frames = frames;
    good += capture.error();
  }
  // The noise is measured to a few per cent. With equal weights the error is three times as large.
  EXPECT_LT(all, 1.1 * good);
}

TEST(UnequalNoise, TrainingErrorRefersToThePhotographs) {
  const UnequalCapture capture;
  const ReflectanceField field = estimate_field(capture.session, options_without_checks());
  std::vector<Image> predicted, observed;
  for (const CaptureFrame& frame : capture.session.frames) {
    observed.push_back(read_image(frame.observed));
    predicted.push_back(field.relight(capture.scene.lights[observed.size() - 1]));
  }
  const auto expected = relative_rmse_map(predicted, observed).values;
  for (std::size_t p = 0; p < expected.size(); ++p)
    EXPECT_NEAR(field.quality.training_error[p], expected[p], 0.002 * expected[p]) << p;
}

TEST(UnequalNoise, PredictedErrorRefersToThePhotographs) {
  const UnequalCapture capture;
  EstimateOptions options;
  options.keep_outliers = true;
  const ReflectanceField field = estimate_field(capture.session, options);
  std::vector<float> noise = field.quality.photograph_noise;
  // Relative to the root mean square over all photographs, a third of which have ten times the noise.
  EXPECT_NEAR(quantile(std::move(noise), 0.5), 0.01 * std::sqrt((2.0 + 100.0) / 3.0), 0.01);
}

TEST(UnequalNoise, TheDeclaredNoiseIsNotUsed) {
  const UnequalCapture capture;
  const ReflectanceField before = estimate_field(capture.session, options_without_checks());
  for (std::size_t j = 0; j < capture.session.frames.size(); ++j) {
    const Photograph photograph = read_photograph(capture.session.frames[j].observed);
    Image sigma = photograph.radiance;
    for (float& value : sigma.values) value = j % 2 == 0 ? 1e-6f : 10.0f;
    write_photograph(capture.session.frames[j].observed, {photograph.radiance, sigma});
  }
  EXPECT_EQ(estimate_field(capture.session, options_without_checks()).transfer.weight,
            before.transfer.weight);
}

TEST(PoorCapture, ADarkPhotographHarmsNone) {
  const test::StabilityScene scene;
  const double undisturbed = undisturbed_error(scene);
  std::vector<LightMap> lights = scene.lights;
  for (float& value : lights[7].radiance.values) value *= 1e-4f;
  const test::TemporaryFolder folder;
  const auto session = test::write_capture(folder / "session", scene.truth, lights, 0.01);
  test::change_photograph(session.frames[7], [](Image& image) {
    Rng rng(3);
    for (float& value : image.values) value = static_cast<float>(std::max(value + 1e-3 * rng.normal(), 0.0));
  });
  EXPECT_LT(scene.error(estimate_field(session, options_without_checks())), 1.1 * undisturbed);
}

TEST(PoorCapture, ClippedSamplesAreLeftOutUpToAThird) {
  const test::StabilityScene scene;
  const double undisturbed = undisturbed_error(scene);
  for (const double clipped : {0.1, 0.2, 0.3}) {
    const test::TemporaryFolder folder;
    const auto session = test::write_capture(folder / "session", scene.truth, scene.lights, 0.01);
    std::vector<float> all;
    for (const CaptureFrame& frame : session.frames) {
      const Image image = read_image(frame.observed);
      all.insert(all.end(), image.values.begin(), image.values.end());
    }
    const auto level = static_cast<float>(quantile(std::move(all), 1.0 - clipped));
    for (const CaptureFrame& frame : session.frames)
      test::change_photograph(frame, [&](Image& image) {
        for (float& value : image.values) value = std::min(value, level);
      });
    EstimateOptions knowing = options_without_checks();
    knowing.clip_level = level;
    const double found = scene.error(estimate_field(session, knowing));
    const double unknowing = scene.error(estimate_field(session, options_without_checks()));
    const double constant = scene.error_of_constant(session), ridge = scene.error_of_ridge(session);
    test::record_figure(
        {"clipping", percent(clipped) + ", --clip given", found, undisturbed, constant, ridge});
    test::record_figure(
        {"clipping", percent(clipped) + ", taken as measured", unknowing, undisturbed, constant, ridge});
    EXPECT_LE(found, worst_against_baselines * std::min(constant, ridge));
    EXPECT_LT(found, unknowing);
  }
}

TEST(PoorCapture, ASunDoesNotBlindTheRest) {
  const test::StabilityScene scene;
  const double undisturbed = undisturbed_error(scene);
  std::vector<LightMap> lights = scene.lights;
  for (std::size_t j = 0; j < lights.size(); j += 8) {
    Rng rng(77, j);
    for (int c = 0; c < 3; ++c)
      lights[j].radiance.at(static_cast<int>(rng.below(32)), static_cast<int>(rng.below(24)), c) = 1e5f;
  }
  stable_error(scene, lights, 0.01, "a sun", "1e5 in every eighth light", undisturbed);
}

TEST(PoorCapture, ColoursThatMixAreBeyondTheModelAndDegradeGently) {
  // The model gives each channel its own transport; light that changes colour (dispersion, a camera whose
  // channels overlap) does not fit it: the error is about the share that mixes.
  const test::StabilityScene scene;
  const double undisturbed = undisturbed_error(scene);
  for (const double mixed : {0.02, 0.1}) {
    const test::TemporaryFolder folder;
    const auto session = test::write_capture(folder / "session", scene.truth, scene.lights, 0.01);
    for (const CaptureFrame& frame : session.frames)
      test::change_photograph(frame, [&](Image& image) {
        for (std::size_t p = 0; p < image.pixel_count(); ++p) {
          float* v = image.values.data() + 3 * p;
          const double r = v[0], g = v[1], b = v[2];
          v[0] = static_cast<float>((1.0 - mixed) * r + mixed * g);
          v[1] = static_cast<float>((1.0 - mixed) * g + mixed * b);
          v[2] = static_cast<float>((1.0 - mixed) * b + mixed * r);
        }
      });
    const double found = scene.error(estimate_field(session, options_without_checks()));
    test::record_figure({"colours that mix", percent(mixed), found, undisturbed,
                         scene.error_of_constant(session), scene.error_of_ridge(session)});
    EXPECT_LE(found, mixed + 0.02);
  }
}

TEST(PoorCapture, LightMapsOfOneTexelAndOfPrimeSizesWork) {
  for (const auto& [width, height] : {std::pair{1, 1}, {1, 7}, {31, 17}, {13, 2}}) {
    SCOPED_TRACE(std::to_string(width) + "×" + std::to_string(height));
    const test::TemporaryFolder folder;
    const auto lights = test::random_lights(40, width, height, 6);
    const auto truth =
        test::field_of_boxes(9, 7, lights[0].domain(), {{0, 0, width, height}, {0, 0, 1, 1}}, 3);
    const auto session = test::write_capture(folder / "session", truth, lights, 0.01);
    const auto field = estimate_field(session, options_without_checks());
    std::vector<Image> predicted, exact;
    for (const auto& light : test::random_lights(6, width, height, 60)) {
      predicted.push_back(field.relight(light));
      exact.push_back(truth.relight(light));
    }
    const double found = relative_rmse(predicted, exact);
    test::record_figure({"size of the light map", std::to_string(width) + "×" + std::to_string(height), found,
                         found, 0.0, 0.0});
    EXPECT_LT(found, 0.03);
  }
}

}  // namespace
}  // namespace refield
