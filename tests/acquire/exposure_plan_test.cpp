// SPDX-License-Identifier: Apache-2.0
#include "acquire/capture/exposure_plan.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "core/base/errors.h"

namespace refield {
namespace {

CameraDescription camera() {
  return {"test", 10, 10, PixelLayout::grey, 12, Seconds(1e-4), Seconds(4.0), Seconds(1.0 / 30)};
}

CameraCalibration calibration() {
  CameraCalibration c;
  c.linear_from_dn = linear_response(12);
  c.black_level_dn = 64.0;
  return c;
}

/// A camera whose brightest sample reaches `dn_per_second` above black.
Probe probe_of(double dn_per_second, int* count = nullptr) {
  return [=](Seconds exposure) {
    if (count) ++*count;
    RawFrame frame{10, 10, PixelLayout::grey, {}, {}, exposure, 1.0, 0};
    for (int i = 0; i < 100; ++i) {
      const double dn = 64.0 + dn_per_second * exposure.count() * (0.5 + 0.5 * i / 99.0);
      frame.samples.push_back(static_cast<std::uint16_t>(std::min(std::round(dn), 4095.0)));
    }
    return frame;
  };
}

TEST(ExposurePlan, GrowsExponentially) {
  ExposurePlanOptions options;
  options.shortest = Seconds(0.002);
  const auto plan = exponential_exposures(options, camera());
  ASSERT_EQ(plan.size(), 4u);
  for (std::size_t i = 0; i < 4; ++i) EXPECT_NEAR(plan[i].count(), 0.002 * std::pow(4.0, i), 1e-12);
}

TEST(ExposurePlan, KeepsToRefreshPeriods) {
  ExposurePlanOptions options;
  options.shortest = Seconds(0.02);
  options.ratio = 3.0;
  options.multiple_of = Seconds(1.0 / 60);
  for (Seconds time : exponential_exposures(options, camera()))
    EXPECT_NEAR(std::remainder(time.count(), 1.0 / 60), 0.0, 1e-12);
}

TEST(ExposurePlan, RefusesWhatTheCameraCannotDo) {
  ExposurePlanOptions options;
  options.shortest = Seconds(0.5);  // the fourth would be 32 s
  EXPECT_THROW(exponential_exposures(options, camera()), InputError);
  options.shortest = Seconds(1e-5);
  EXPECT_THROW(exponential_exposures(options, camera()), InputError);
  options = {};
  EXPECT_THROW(exponential_exposures(options, camera()), InputError);
  options.shortest = Seconds(0.01);
  options.count = 0;
  EXPECT_THROW(exponential_exposures(options, camera()), InputError);
  EXPECT_THROW(check_exposures({Seconds(0.1), Seconds(0.1)}, camera()), InputError);
  EXPECT_THROW(check_exposures({}, camera()), InputError);
}

TEST(ExposurePlan, ProbingUsesTheRangeWithoutClipping) {
  for (double brightness : {50.0, 3e3, 4e5, 5e6}) {
    int probes = 0;
    const Seconds shortest = shortest_useful_exposure(camera(), calibration(), probe_of(brightness, &probes));
    const double peak = brightness * shortest.count() / (4095.0 - 64.0);
    const bool at_the_end = shortest == camera().longest_exposure || shortest == camera().shortest_exposure;
    EXPECT_TRUE(at_the_end || (peak > 0.75 && peak < 0.9)) << brightness << " " << peak;
    EXPECT_LE(probes, 6);
  }
}

TEST(ExposurePlan, ProbingStopsAtTheCamerasEnds) {
  EXPECT_EQ(shortest_useful_exposure(camera(), calibration(), probe_of(1e9)), camera().shortest_exposure);
  EXPECT_EQ(shortest_useful_exposure(camera(), calibration(), probe_of(10.0)), camera().longest_exposure);
  EXPECT_THROW(shortest_useful_exposure(camera(), calibration(), probe_of(0.0)), InputError);
}

TEST(ExposurePlan, NamesExposuresThatAreWasted) {
  const std::vector<Seconds> plan = {Seconds(0.001), Seconds(0.004), Seconds(0.016)};
  EXPECT_TRUE(wasted_exposures(plan, {0.01, 0.5, 0.9}).empty());
  const auto sentences = wasted_exposures(plan, {0.0, 0.5, 0.9});
  ASSERT_EQ(sentences.size(), 1u);
  EXPECT_NE(sentences[0].find("0.001 s"), std::string::npos);
}

ExposurePlanOptions with_noise(double bound) {
  ExposurePlanOptions options;
  options.relative_noise = bound;
  return options;
}

CameraCalibration noisy_camera() {
  CameraCalibration c = calibration();
  c.electrons_per_dn = 4.0;
  c.read_noise_electrons = 3.0;
  c.electrons_per_radiance_second = 200'000.0;
  return c;
}

TEST(NoisePlan, OneExposureDoesForANarrowRange) {
  const NoisePlan plan = min_exposures({0.5, 1.0}, with_noise(0.03), camera(), noisy_camera(), 1.0, 1);
  EXPECT_EQ(plan.exposures.size(), 1u);
  EXPECT_TRUE(plan.reached);
  EXPECT_LE(plan.worst_noise, 0.03);
}

TEST(NoisePlan, TakesNoMoreExposuresThanAnySeriesNeeds) {
  const SceneRange range{0.002, 1.0};
  const double bound = 0.02;
  const NoisePlan plan = min_exposures(range, with_noise(bound), camera(), noisy_camera(), 1.0, 1);
  ASSERT_TRUE(plan.reached) << plan.sentence();
  ASSERT_EQ(plan.exposures.size(), 4u) << plan.sentence();
  // No three exposures do it: the shortest must hold the bright end, the others are tried out.
  const auto worst_of = [&](const std::vector<Seconds>& exposures) {
    double worst = 0.0;
    for (int i = 0; i <= 60; ++i)
      worst = std::max(
          worst, predicted_noise(range.dark * std::pow(500.0, i / 60.0), exposures, noisy_camera(), 1.0, 1));
    return worst;
  };
  EXPECT_LE(worst_of(plan.exposures), bound * 1.001);
  double best = 1.0;
  for (double first = 1.0; first <= 1.12; first += 0.04)  // up to the clipping of the bright end
    for (double second = 1.2; second < 40.0; second *= 1.1)
      for (double third = second * 1.1; third < 600.0; third *= 1.1)
        best = std::min(best, worst_of({plan.exposures[0] * first, plan.exposures[0] * second,
                                        plan.exposures[0] * third}));
  EXPECT_GT(best, bound);
}

TEST(NoisePlan, KeepsToWholePeriodsAndToTheCamera) {
  ExposurePlanOptions options = with_noise(0.05);
  options.multiple_of = Seconds(1.0 / 240);
  const NoisePlan plan = min_exposures({1e-4, 1.0}, options, camera(), noisy_camera(), 1.0, 1);
  EXPECT_GT(plan.exposures.size(), 1u);
  for (Seconds exposure : plan.exposures) {
    EXPECT_NEAR(std::remainder(exposure.count(), 1.0 / 240), 0.0, 1e-9);
    EXPECT_LE(exposure, camera().longest_exposure);
  }
  EXPECT_NO_THROW(check_exposures(plan.exposures, camera()));
}

TEST(NoisePlan, SaysWhenTheWellIsTooSmall) {
  // 14 500 electrons have 0.8 % of noise by themselves.
  const NoisePlan plan = min_exposures({0.5, 1.0}, with_noise(0.005), camera(), noisy_camera(), 1.0, 1);
  EXPECT_FALSE(plan.reached);
  EXPECT_NE(plan.sentence().find("more frames per exposure"), std::string::npos) << plan.sentence();
  EXPECT_TRUE(min_exposures({0.5, 1.0}, with_noise(0.005), camera(), noisy_camera(), 1.0, 8).reached);
}

TEST(NoisePlan, RangeIsMeteredFromTheScene) {
  const CameraCalibration c = noisy_camera();
  const double per_second = c.electrons_per_radiance_second / c.electrons_per_dn;
  const SceneRange range = meter_range(camera(), c, probe_of(per_second * 0.8));  // radiance 0.4 to 0.8
  EXPECT_NEAR(range.bright, 0.8, 0.01);
  EXPECT_NEAR(range.dark, 0.2 * 0.4 * 1.05, 0.01);
}

TEST(SettableExposures, AreWholeStepsOfTheCameraEachOnce) {
  CameraDescription camera;
  camera.shortest_exposure = Seconds(1e-4);
  camera.longest_exposure = Seconds(0.5);
  const std::vector<Seconds> wanted = {Seconds(2e-5), Seconds(1.2e-4), Seconds(0.003162), Seconds(0.7)};
  EXPECT_EQ(settable_exposures(wanted, camera), wanted);  // any will do
  camera.exposure_step = Seconds(1e-4);
  const auto settable = settable_exposures(wanted, camera);
  ASSERT_EQ(settable.size(), 3u);
  constexpr double rounding = 1e-12;
  EXPECT_NEAR(settable[0].count(), 1e-4, rounding);
  EXPECT_NEAR(settable[1].count(), 0.0032, rounding);
  EXPECT_NEAR(settable[2].count(), 0.5, rounding);
}

CameraDescription with_listed_exposures() {
  CameraDescription listed = camera();
  listed.exposures = {Seconds(1.0 / 8000), Seconds(1.0 / 125), Seconds(1.0 / 60), Seconds(1.0 / 30),
                      Seconds(0.5)};
  listed.shortest_exposure = listed.exposures.front();
  listed.longest_exposure = listed.exposures.back();
  return listed;
}

TEST(ListedExposures, AreTheNearestByRatioEachOnce) {
  const CameraDescription listed = with_listed_exposures();
  const auto settable = settable_exposures(
      {Seconds(1e-5), Seconds(0.009), Seconds(0.0115), Seconds(0.0122), Seconds(9)}, listed);
  EXPECT_EQ(settable,
            (std::vector<Seconds>{Seconds(1.0 / 8000), Seconds(1.0 / 125), Seconds(1.0 / 60), Seconds(0.5)}));
}

TEST(ListedExposures, OthersAreRefusedNamingTheNearest) {
  const CameraDescription listed = with_listed_exposures();
  EXPECT_NO_THROW(require_listed_exposures({Seconds(0.0167), Seconds(0.033333)}, listed));
  EXPECT_NO_THROW(require_listed_exposures({Seconds(0.0123)}, camera()));
  try {
    require_listed_exposures({Seconds(0.008), Seconds(0.02)}, listed);
    FAIL() << "0.02 s is not listed";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("exposure 2 of the plan, 0.02 s"), std::string::npos)
        << error.what();
    EXPECT_NE(std::string(error.what()).find("0.0166667 s and 0.0333333 s"), std::string::npos)
        << error.what();
  }
}

TEST(ListedExposures, ProbingAndNoisePlansUseNoOthers) {
  const CameraDescription listed = with_listed_exposures();
  const Probe probe = [&, answer = probe_of(100'000.0)](Seconds exposure) {
    EXPECT_NE(std::ranges::find(listed.exposures, exposure), listed.exposures.end()) << exposure.count();
    return answer(exposure);
  };
  shortest_useful_exposure(listed, calibration(), probe);
  ExposurePlanOptions options;
  options.relative_noise = 0.05;
  const NoisePlan plan = min_exposures({0.01, 1.0}, options, listed, noisy_camera(), 1.0, 1);
  for (Seconds exposure : plan.exposures)
    EXPECT_NE(std::ranges::find(listed.exposures, exposure), listed.exposures.end()) << exposure.count();
}

}  // namespace
}  // namespace refield
