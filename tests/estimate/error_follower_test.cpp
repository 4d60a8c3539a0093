// SPDX-License-Identifier: Apache-2.0
#include "estimate/quality/error_follower.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "core/base/errors.h"
#include "core/image/image_io.h"
#include "core/image/metrics.h"
#include "estimate/estimate.h"
#include "tests/support/synthetic_capture.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

constexpr double noise = 0.02;

class Follow : public ::testing::Test {
 protected:
  Follow()
      : lights_(test::random_lights(60, 16, 12, 3)),
        truth_(test::field_of_boxes(18, 14, lights_[0].domain(),
                                    {{0, 0, 8, 6}, {8, 6, 12, 9}, {4, 0, 8, 12}, {1, 7, 3, 11}}, 9)),
        session_(test::write_capture(folder_ / "session", truth_, lights_, noise)) {
    options_.kernels = 10;
    // All pixels see the same four boxes here, so neighbours would help more than in any real scene.
    options_.spatial_passes = 0;
  }
  /// What the field of the first images has on new photographs as noisy, median pixel.
  double actual_error(int images) const {
    CaptureSession first = session_;
    first.frames.resize(images);
    EstimateOptions by_data = options_;
    by_data.kernels = 0;  // with the regression on cells, which ten kernels rule out
    const auto field = estimate_field(first, by_data);
    SeriesError series;
    for (const LightMap& light : test::random_lights(20, 16, 12, 99))
      series.add(field.relight(light), truth_.relight(light));
    return std::hypot(series.pixel_quantile(0.5), noise);
  }

  test::TemporaryFolder folder_;
  std::vector<LightMap> lights_;
  ReflectanceField truth_;
  CaptureSession session_;
  EstimateOptions options_;
};

TEST_F(Follow, PredictsTheErrorOfTheImagesSoFar) {
  ErrorFollower follower(options_);
  EXPECT_THROW(follower.predict(), InputError);
  double before = 1.0;
  for (const int images : {30, 45, 60}) {
    while (follower.images() < images)
      follower.add(session_.frames[follower.images()], Parameterisation::monitor);
    const FollowedError error = follower.predict();
    EXPECT_EQ(error.images, images);
    // 1.23 from 45 images on, which is the safe side: predictions lie halfway between leave-one-out and
    // cross-validation, whose fits to four fifths of the images are worse than the field's.
    const double ratio = *error.predicted / actual_error(images);
    EXPECT_GT(ratio, 0.8) << images;
    EXPECT_LT(ratio, 1.25) << images;
    EXPECT_LT(*error.predicted, before);
    before = *error.predicted;
  }
  EXPECT_EQ(follower.images_for(0.5), 60) << "reached already";
}

TEST_F(Follow, ASampleOfPixelsIsEnough) {
  ErrorFollower all(options_), some(options_, 40);
  for (int j = 0; j < 40; ++j) {
    all.add(session_.frames[j], Parameterisation::monitor);
    some.add(session_.frames[j], Parameterisation::monitor);
  }
  EXPECT_NEAR(*some.predict().predicted / *all.predict().predicted, 1.0, 0.15);
}

/// A camera whose channels see 10 % of other primaries: fields are estimated without that.
TEST_F(Follow, MixedChannelsAreToldFromThePrimaries) {
  std::vector<LightMap> lights;
  for (std::size_t primary = 0; primary < 3; ++primary) {
    lights.push_back({Image(16, 12, 3), Parameterisation::monitor});
    for (std::size_t i = primary; i < lights.back().radiance.values.size(); i += 3)
      lights.back().radiance.values[i] = 1.0f;
  }
  lights.insert(lights.end(), lights_.begin(), lights_.begin() + 30);
  const CaptureSession session = test::write_capture(folder_ / "primaries", truth_, lights, noise);
  std::array<double, 2> predicted{};
  for (const bool is_mixed : {false, true}) {
    ErrorFollower follower(options_);
    for (const CaptureFrame& frame : session.frames) {
      if (is_mixed) {
        Photograph photograph = read_photograph(frame.observed);
        std::vector<float>& values = photograph.radiance.values;
        for (std::size_t i = 0; i < values.size(); i += 3) {
          const float red = values[i], green = values[i + 1];
          values[i] += 0.1f * green;
          values[i + 1] += 0.1f * red + 0.1f * values[i + 2];
        }
        write_photograph(frame.observed, photograph);
      }
      follower.add(frame, Parameterisation::monitor);
    }
    predicted[is_mixed] = *follower.predict().predicted;
  }
  EXPECT_NEAR(predicted[1] / predicted[0], 1.0, 0.05);  // 1.5 or more with the channels as they are
}

TEST_F(Follow, PredictsForTheExpectedLight) {
  const auto predicted = [&](std::vector<LightMap> expected) {
    ErrorFollower follower(options_);
    follower.expect(std::move(expected));
    for (int j = 0; j < 40; ++j) follower.add(session_.frames[j], Parameterisation::monitor);
    return follower.predict().predicted.value();
  };
  const double own = predicted({});
  auto alike = test::random_lights(12, 16, 12, 99);
  const double same_kind = predicted(alike);
  EXPECT_NEAR(same_kind / own, 1.0, 0.2);  // other lights of the photographs' kind
  for (LightMap& light : alike)
    for (float& v : light.radiance.values) v *= 4.0f;
  EXPECT_NEAR(predicted(alike), same_kind, 1e-4 * same_kind) << "the error is relative";
  // Under small lights a field misses more of what a pixel shows than under lights that are mixtures.
  std::vector<LightMap> spots;
  for (int i = 0; i < 4; ++i) {
    spots.push_back({Image(16, 12, 3), Parameterisation::monitor});
    for (int c = 0; c < 3; ++c) spots.back().radiance.at(3 + 3 * i, 2 + 2 * i, c) = 1.0f;
  }
  EXPECT_GT(predicted(spots), 1.5 * same_kind);
}

TEST_F(Follow, RefusesPhotographsOfAnotherSize) {
  ErrorFollower follower(options_);
  follower.add(session_.frames[0], Parameterisation::monitor);
  write_photograph(session_.frames[1].observed, {Image(4, 4, 3, 1.0f), {}});
  EXPECT_THROW(follower.add(session_.frames[1], Parameterisation::monitor), InputError);
}

}  // namespace
}  // namespace refield
