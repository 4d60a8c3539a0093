// SPDX-License-Identifier: Apache-2.0
// The window monitor on a real X server without a screen (Xvfb): what a screenshot holds is what was to be
// shown.
#include "acquire/devices/monitors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/rng.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/virtual_screen.h"

namespace refield {
namespace {

using test::TemporaryFolder;
using ::testing::HasSubstr;

constexpr int screen_width = 320;
constexpr int screen_height = 200;

DriveImage random_pattern(Rng& random, int width, int height) {
  DriveImage image{width, height, {}};
  for (int i = 0; i < width * height * 3; ++i)
    image.levels.push_back(static_cast<std::uint8_t>(random.below(256)));
  return image;
}

class WindowMonitorOnScreen : public ::testing::Test {
 protected:
  void SetUp() override {
#ifdef __SANITIZE_THREAD__
    GTEST_SKIP() << "SKIPPED: the software renderer's threads are not instrumented";
#endif
    if (!test::is_installed("Xvfb") || !test::is_installed("xwd"))
      GTEST_SKIP() << "SKIPPED: Xvfb or xwd is not installed (Debian packages xvfb and x11-apps)";
    ::unsetenv("WAYLAND_DISPLAY");
    screen_ = std::make_unique<test::VirtualScreen>(screen_width, screen_height);
    ASSERT_TRUE(screen_->is_up()) << "Xvfb does not start";
  }
  const TemporaryFolder folder_;
  std::unique_ptr<test::VirtualScreen> screen_;
};

TEST_F(WindowMonitorOnScreen, ShowsEveryLevelOfEveryPixel) {
  WindowMonitor monitor({});
  EXPECT_EQ(monitor.describe().width, screen_width);
  EXPECT_EQ(monitor.describe().height, screen_height);
  Rng random(4);
  TimePoint last{};
  for (int i = 0; i < 3; ++i) {
    const DriveImage pattern = random_pattern(random, screen_width, screen_height);
    const TimePoint shown = monitor.show(pattern);
    EXPECT_GT(shown, last);
    last = shown;
    EXPECT_TRUE(test::screenshot(folder_ / "screen.xwd", screen_width, screen_height) == pattern.levels)
        << "pattern " << i;
  }
  EXPECT_THROW(monitor.show(random_pattern(random, 64, 40)), InputError);
}

TEST_F(WindowMonitorOnScreen, EnlargesByWholePixelsWithBlackAround) {
  constexpr int width = 90, height = 60, scale = 3, left = 25, top = 10;  // 270×180 on 320×200
  WindowMonitor monitor({0, width, height});
  EXPECT_EQ(monitor.pixels_per_texel(), scale);
  Rng random(5);
  const DriveImage pattern = random_pattern(random, width, height);
  monitor.show(pattern);
  const auto screen = test::screenshot(folder_ / "screen.xwd", screen_width, screen_height);
  ASSERT_EQ(screen.size(), static_cast<std::size_t>(screen_width) * screen_height * 3);
  int wrong = 0;
  for (int y = 0; y < screen_height; ++y)
    for (int x = 0; x < screen_width; ++x)
      for (int c = 0; c < 3; ++c) {
        const bool inside = x >= left && x < left + width * scale && y >= top && y < top + height * scale;
        const int expected =
            inside ? pattern.levels[((y - top) / scale * width + (x - left) / scale) * 3 + c] : 0;
        wrong += screen[(static_cast<std::size_t>(y) * screen_width + x) * 3 + c] != expected;
      }
  EXPECT_EQ(wrong, 0);
}

TEST_F(WindowMonitorOnScreen, SaysWhatIsNotThere) {
  const auto displays = window_displays();
  ASSERT_EQ(displays.size(), 1U);
  EXPECT_EQ(displays[0].width, screen_width);
  EXPECT_THROW(WindowMonitor({3, 0, 0}), InputError);
  EXPECT_THROW(WindowMonitor({0, 4000, 3000}), InputError);
  screen_.reset();
  try {
    WindowMonitor monitor({});
    FAIL();
  } catch (const DeviceError& error) {
    EXPECT_THAT(error.what(), HasSubstr("no desktop"));
  }
}

}  // namespace
}  // namespace refield
