// SPDX-License-Identifier: Apache-2.0
// Against the kernel's vkms. That what is shown is what was asked for, pixel for pixel, the closed loop
// tests.
#include "acquire/devices/monitors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>

#include "acquire/calibrate/calibration.h"
#include "core/base/errors.h"
#include "tests/devices/lab.h"

namespace refield {
namespace {

using namespace test;
using testing::HasSubstr;

DrmMonitorOptions vkms() {
  return {.card = "", .connector = "Virtual-1", .mode = "640x480"};
}

TEST(DrmDisplay, ListsConnectorsAndModes) {
  const DrmConnectorInfo connector = find_drm_connector("", "Virtual-1");
  EXPECT_EQ(connector.driver, "vkms");
  EXPECT_TRUE(connector.is_connected);
  EXPECT_EQ(connector.modes[find_drm_mode(connector, "")].text(), "1024x768@60.00");
  EXPECT_EQ(connector.modes[find_drm_mode(connector, "640x480@60")].text(), "640x480@59.94");
  EXPECT_THROW(find_drm_mode(connector, "641x480"), InputError);
  EXPECT_THROW(find_drm_connector("", "HDMI-A-7"), InputError);
}

TEST(DrmMonitor, FlipsAreStampedInOrderByTheMonotonicClock) {
  DrmMonitor monitor(vkms());
  EXPECT_EQ(monitor.describe().width, 640);
  TimePoint last{};
  for (int i = 0; i < 10; ++i) {
    const auto before = std::chrono::steady_clock::now().time_since_epoch();
    const TimePoint flip = monitor.show(uniform_drive(640, 480, static_cast<std::uint8_t>(20 * i)));
    const auto after = std::chrono::steady_clock::now().time_since_epoch();
    EXPECT_GT(flip, last);
    // vkms stamps the blanking that its timer announces, up to one period from the call; other clocks than
    // the monotonic one differ by years.
    constexpr Seconds other_clock(3600.0);
    EXPECT_GT(flip.time_since_epoch(), before - other_clock);
    EXPECT_LT(flip.time_since_epoch(), after + other_clock);
    last = flip;
  }
}

TEST(DrmMonitor, SmallLightMapsAreShownInWholePixels) {
  DrmMonitorOptions options = vkms();
  options.width = 50;
  options.height = 40;
  DrmMonitor monitor(options);
  EXPECT_EQ(monitor.describe().width, 50);
  EXPECT_EQ(monitor.pixels_per_texel(), 12);
  EXPECT_NO_THROW(monitor.show(uniform_drive(50, 40, 7)));
  EXPECT_THROW(monitor.show(uniform_drive(640, 480, 7)), InputError);
  options.width = 700;
  EXPECT_THROW(DrmMonitor{options}, InputError);
}

TEST(DrmMonitor, OneProgramAtATime) {
  const DrmMonitor monitor(vkms());
  try {
    DrmMonitor second(vkms());
    ADD_FAILURE() << "two programs held the display";
  } catch (const DeviceError& error) {
    EXPECT_THAT(error.what(), HasSubstr("uses the display"));
  }
}

TEST(DrmMonitor, AConnectorSwitchedOffIsSaidAndItComesBack) {
  const std::string status = "/sys/class/drm/card0-Virtual-1/status";
  {
    DrmMonitor monitor(vkms());
    monitor.show(uniform_drive(640, 480, 1));
    write_file(status, "off");
    EXPECT_THROW(monitor.show(uniform_drive(640, 480, 2)), DeviceError);
  }
  EXPECT_THROW(DrmMonitor{vkms()}, DeviceError);
  write_file(status, "on");
  DrmMonitor monitor(vkms());
  EXPECT_NO_THROW(monitor.show(uniform_drive(640, 480, 3)));
}

}  // namespace
}  // namespace refield
