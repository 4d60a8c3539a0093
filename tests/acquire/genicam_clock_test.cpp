// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "acquire/devices/tethered_camera.h"
#include "core/base/rng.h"

namespace refield {
namespace {

constexpr std::int64_t ns_per_s = 1'000'000'000;

TEST(GenicamClock, FollowsDriftAndNeverLiesAfterTheExposure) {
  for (const double drift : {-50e-6, 50e-6})
    for (const bool stamps_end : {false, true}) {
      CameraClock clock;
      Rng random(7);
      const Seconds least_delay(0.002);
      double largest = 0.0;
      for (int i = 0; i < 20'000; ++i) {
        const double start = 100.0 + 0.02 * i;  // 400 s: the clocks part by 20 ms
        const Seconds exposure(i % 3 == 0 ? 0.016 : 0.004);
        // One arrival in ten is up to half a second late.
        const double late = random.uniform() < 0.1 ? 0.5 * random.uniform() : 0.001 * random.uniform();
        const double arrival = start + exposure.count() + least_delay.count() + late;
        const double stamped = start + (stamps_end ? exposure.count() : 0.0);
        const auto stamp = static_cast<std::int64_t>((5000.0 + stamped * (1.0 + drift)) * ns_per_s);
        const TimePoint mapped = clock.start_of(
            stamp, TimePoint(std::chrono::nanoseconds(static_cast<std::int64_t>(arrival * ns_per_s))),
            exposure, exposure);
        const double error = std::chrono::duration<double>(mapped.time_since_epoch()).count() - start;
        // Never later than the least delay, which the caller allows for; leaking adds 0.2 ms per second at
        // most.
        ASSERT_LT(error, least_delay.count() + 0.0015) << i;
        largest = std::max(largest, -error);
      }
      // Stamps of the end cost the difference of the exposures; nothing else is given away.
      EXPECT_LT(largest, stamps_end ? 0.013 : 0.001);
    }
}

TEST(GenicamClock, AnUncertainExposureGivesTheEarlierStart) {
  CameraClock clock;
  const auto at = [](double s) {
    return TimePoint(std::chrono::nanoseconds(static_cast<std::int64_t>(s * ns_per_s)));
  };
  EXPECT_EQ(clock.start_of(1 * ns_per_s, at(11.010), Seconds(0.01), Seconds(0.01)), at(11.0));
  EXPECT_EQ(clock.start_of(2 * ns_per_s, at(12.020), Seconds(0.01), Seconds(0.05)), at(11.97));
  EXPECT_GE(clock.start_of(3 * ns_per_s, at(13.010), Seconds(0.01), Seconds(0.01)), at(13.0));
  // A camera that was started again counts from zero.
  EXPECT_EQ(clock.start_of(1 * ns_per_s, at(20.010), Seconds(0.01), Seconds(0.01)), at(20.0));
}

TEST(GenicamClock, FrameIdsWrapAndSkip) {
  FrameCounter counter;
  EXPECT_EQ(counter.number_of(65533), 1u);
  EXPECT_EQ(counter.number_of(65535), 3u);  // one was lost
  EXPECT_EQ(counter.number_of(1), 4u);      // 0 is no id
  EXPECT_EQ(counter.number_of(3), 6u);
  counter.restart();
  EXPECT_EQ(counter.number_of(20'000), 7u);
  EXPECT_EQ(counter.number_of(1), 8u) << "the camera began anew";
  // An incomplete frame is one of those that the next id tells of, whatever its own id.
  EXPECT_EQ(counter.number_of_incomplete(), 9u);
  EXPECT_EQ(counter.number_of(4), 11u);
  EXPECT_EQ(counter.number_of_incomplete(), 12u);
  EXPECT_EQ(counter.number_of_incomplete(), 13u);
  EXPECT_EQ(counter.number_of(5), 14u) << "one of the two was handed over twice";
  FrameCounter wide;
  wide.number_of(65535);
  EXPECT_EQ(wide.number_of(65536), 2u);
  EXPECT_EQ(wide.number_of(70'000), 2u + 4464u);
}

}  // namespace
}  // namespace refield
