// SPDX-License-Identifier: Apache-2.0
#include "acquire/series/match_series.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "core/base/errors.h"
#include "core/base/rng.h"

namespace refield {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Pair;

constexpr ClockSeconds morning = 1'087'800'000.0;

/// Clouds: a sum of slow waves of many periods, in log brightness.
class Clouds {
 public:
  explicit Clouds(std::uint64_t seed) {
    Rng random(seed);
    for (int i = 0; i < 40; ++i)
      waves_.push_back({random.uniform(300.0, 6000.0), random.uniform(0.0, 6.28), 0.15 * random.normal()});
  }
  double brightness(ClockSeconds t) const {
    double log_brightness = 0.4 * std::sin((t - morning) / 14000.0);  // the day
    for (const Wave& wave : waves_)
      log_brightness += wave.size * std::sin(t * 6.2832 / wave.period + wave.phase);
    return std::exp(log_brightness);
  }

 private:
  struct Wave {
    double period, phase, size;
  };
  std::vector<Wave> waves_;
};

/// A camera that takes a photograph about every two minutes and now and then misses one.
std::vector<TimedBrightness> series(const Clouds& clouds, std::uint64_t seed, int count, double clock_ahead,
                                    double drift, double gain, double noise) {
  Rng random(seed);
  std::vector<TimedBrightness> result;
  for (int i = 0; i < count; ++i) {
    const double t = morning + 120.0 * i + random.uniform(-2.0, 2.0);
    if (random.uniform() < 0.05) continue;
    result.push_back({t + clock_ahead + drift * (t - morning),
                      gain * clouds.brightness(t) * std::exp(noise * random.normal())});
  }
  return result;
}

TEST(EstimateClocks, TellsOffsetAndDrift) {
  const Clouds clouds(1);
  for (const auto& [ahead, drift] : {std::pair{734.2, 0.0}, {-1911.0, 60e-6}, {12.0, -45e-6}}) {
    const auto scene = series(clouds, 2, 600, ahead, drift, 0.02, 0.02);
    const auto light = series(clouds, 3, 600, 0.0, 0.0, 5.0, 0.02);
    const ClockEstimate estimate = estimate_clocks(scene, light, 3600.0, drift != 0.0);
    EXPECT_GT(estimate.correlation, 0.9);
    EXPECT_LT(estimate.runner_up, 0.8);
    constexpr double twentieth_of_the_interval = 6.0;
    for (double at : {0.0, 36000.0, 70000.0})
      EXPECT_NEAR(estimate.relation.first_from_second(morning + at), morning + at + ahead + drift * at,
                  twentieth_of_the_interval);
  }
}

std::string refusal(const std::vector<TimedBrightness>& a, const std::vector<TimedBrightness>& b) {
  try {
    estimate_clocks(a, b, 3600.0, false);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

TEST(EstimateClocks, DoesNotGuess) {
  const auto one = series(Clouds(1), 2, 400, 0.0, 0.0, 1.0, 0.02);
  EXPECT_THAT(refusal(one, series(Clouds(9), 3, 400, 0.0, 0.0, 1.0, 0.02)), HasSubstr("--offset"));
  EXPECT_THAT(refusal(one, {one.begin(), one.begin() + 5}), HasSubstr("too short"));
  std::vector<TimedBrightness>
      blinking;  // a light source that goes on and off every 20 minutes fits at many offsets
  for (int i = 0; i < 400; ++i) blinking.push_back({morning + 120.0 * i, i / 5 % 2 ? 2.0 : 1.0});
  EXPECT_THAT(refusal(blinking, blinking), HasSubstr("several offsets"));
}

TEST(MatchInTime, TakesTheNearestOnce) {
  const std::vector<ClockSeconds> first = {0.0, 100.0, 130.0, 500.0};
  const std::vector<ClockSeconds> second = {-12.0, 118.0, 300.0, 521.0};
  // With the second clock 10 s behind: −2, 128, 310, 531.
  EXPECT_THAT(match_in_time(first, second, {10.0, 0.0, 0.0}, 30.0), ElementsAre(Pair(0, 0), Pair(2, 1)));
  EXPECT_THAT(match_in_time(first, second, {10.0, 0.0, 0.0}, 31.0),
              ElementsAre(Pair(0, 0), Pair(2, 1), Pair(3, 3)));
  EXPECT_TRUE(match_in_time(first, {}, {}, 30.0).empty());
}

TEST(CaptureTime, IsReadFromTextAndNames) {
  const auto noon = clock_seconds_from_text("2004:06:21 12:30:05");
  ASSERT_TRUE(noon);
  EXPECT_DOUBLE_EQ(*noon, 1087821005.0);  // date -u -d '2004-06-21 12:30:05' +%s
  EXPECT_DOUBLE_EQ(*clock_seconds_from_text("2004-06-21T12:30:05.25"), *noon + 0.25);
  EXPECT_EQ(text_from_clock_seconds(*noon + 0.25), "2004-06-21T12:30:05.250");
  for (const char* name : {"IMG_20040621_123005", "20040621123005", "sky-2004-06-21T12.30.05",
                           "a 2004-06-21 12h30m05", "P1_2004.06.21_12-30-05_hdr"})
    EXPECT_EQ(clock_seconds_from_name(name), noon) << name;
  EXPECT_DOUBLE_EQ(*clock_seconds_from_name("cam_20040621_123005_250"), *noon + 0.25);
  for (const char* name : {"train_007", "20041321_123005", "12345678901234567", "20040621_126105"})
    EXPECT_FALSE(clock_seconds_from_name(name)) << name;
  for (const char* text :
       {"", "2004-06-31 12:00:00", "2004-06-21", "2004:06:21 25:00:00", "x2004:06:21 12:00:00"})
    EXPECT_FALSE(clock_seconds_from_text(text)) << text;
}

}  // namespace
}  // namespace refield
