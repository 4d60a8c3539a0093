// SPDX-License-Identifier: Apache-2.0
// Against the kernel's gpio-sim: outputs are read back, inputs driven, in sysfs.
#include "acquire/devices/gpio_trigger.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <sstream>
#include <thread>

#include "core/base/errors.h"
#include "tests/devices/lab.h"

namespace refield {
namespace {

using namespace test;
using testing::HasSubstr;
namespace fs = std::filesystem;

constexpr const char* config = "/sys/kernel/config/gpio-sim/lab";
constexpr Seconds patience{600};  // ends what hangs

/// The levels that GPIO outputs are set to since its construction, as the kernel's tracing sees them: a pulse
/// is not missed, however busy the machine is. boot.sh switches that tracing on.
class OutputTrace {
 public:
  OutputTrace() { write_file(trace_file, ""); }

  struct Event {
    double seconds;  // since the machine was started
    std::string level;
  };
  std::vector<Event> events() const {
    // "  test_devices-97  [001] .....  12.345678: gpio_value: 505 set 1"
    std::vector<Event> events;
    std::istringstream trace(read_file(trace_file));
    for (std::string line; std::getline(trace, line);) {
      const auto end = line.find(": gpio_value: "), set = line.find(" set ");
      if (end == std::string::npos || set == std::string::npos) continue;
      const auto begin = line.rfind(' ', end - 1);
      events.push_back({std::stod(line.substr(begin, end - begin)), line.substr(set + 5)});
    }
    return events;
  }

 private:
  static constexpr const char* trace_file = "/sys/kernel/debug/tracing/trace";
};

class GpioTriggerTest : public testing::Test {
 protected:
  void SetUp() override {
    fs::create_directory(config);
    fs::create_directory(std::string(config) + "/bank");
    write_file(std::string(config) + "/bank/num_lines", "8");
    write_file(std::string(config) + "/live", "1");
    plugged_ = true;
  }
  void TearDown() override {
    unplug();
    fs::remove(std::string(config) + "/bank");
    fs::remove(config);
  }
  void unplug() {
    if (plugged_) write_file(std::string(config) + "/live", "0");
    plugged_ = false;
  }
  std::string word(const std::string& path) const {
    std::string text = read_file(path);
    while (text.ends_with('\n')) text.pop_back();
    return text;
  }
  GpioLineAddress line(unsigned number, bool active_low = false) const {
    return {word(std::string(config) + "/bank/chip_name"), number, active_low};
  }
  std::string sysfs(unsigned number) const {
    return "/sys/devices/platform/" + word(std::string(config) + "/dev_name") + "/" +
           word(std::string(config) + "/bank/chip_name") + "/sim_gpio" + std::to_string(number) + "/";
  }
  std::string level(unsigned number) const { return word(sysfs(number) + "value"); }
  void pull(unsigned number, bool up) const {
    write_file(sysfs(number) + "pull", up ? "pull-up" : "pull-down");
  }
  bool plugged_ = false;
};

TEST_F(GpioTriggerTest, ChipsAreListed) {
  const auto chips = find_gpio_chips();
  ASSERT_FALSE(chips.empty());
  EXPECT_EQ(chips.back().lines, 8u);
  const GpioTrigger taken({.trigger = line(3)});
  EXPECT_THAT(find_gpio_chips().back().named_lines, testing::ElementsAre("3 (used by refield)"));
}

TEST_F(GpioTriggerTest, APulseOfTheRequestedWidthAndPolarity) {
  for (bool active_low : {false, true}) {
    GpioTriggerOptions options{.trigger = line(1, active_low)};
    options.pulse_width = Seconds(0.02);
    GpioTrigger trigger(options);
    EXPECT_EQ(level(1), active_low ? "1" : "0");
    const OutputTrace trace;
    trigger.fire();
    const auto events = trace.events();
    ASSERT_EQ(events.size(), 2u);
    EXPECT_EQ(events[0].level, active_low ? "0" : "1");
    EXPECT_EQ(events[1].level, active_low ? "1" : "0");
    EXPECT_GE(events[1].seconds - events[0].seconds, 0.0199) << "microseconds are rounded";
    EXPECT_EQ(level(1), active_low ? "1" : "0");
  }
}

TEST_F(GpioTriggerTest, WaitsForReadyAndReportsTheStrobe) {
  GpioTriggerOptions options{.trigger = line(1)};
  options.ready = line(2);
  options.strobe = line(4);
  options.light_source = line(5);
  options.timeout = patience;
  GpioTrigger trigger(options);
  EXPECT_EQ(level(5), "1");
  const OutputTrace trace;
  MonotonicClock::duration exposed{};
  std::thread camera([&] {
    EXPECT_TRUE(trace.events().empty()) << "triggered before the camera was ready";
    pull(2, true);
    while (trace.events().empty()) std::this_thread::yield();
    exposed = MonotonicClock::duration(std::chrono::steady_clock::now().time_since_epoch());
    pull(4, true);
  });
  const TimePoint strobe = trigger.fire();
  camera.join();
  EXPECT_GT(strobe.time_since_epoch(), exposed);
  EXPECT_LT(strobe.time_since_epoch(), std::chrono::steady_clock::now().time_since_epoch());
}

TEST_F(GpioTriggerTest, TimeOutsNameTheLine) {
  GpioTriggerOptions options{.trigger = line(1)};
  options.ready = line(2);
  options.timeout = Seconds(0.3);
  GpioTrigger trigger(options);
  try {
    trigger.fire();
    ADD_FAILURE() << "the camera was never ready";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.error_number(), ETIMEDOUT);
    EXPECT_THAT(error.what(), HasSubstr("line 2"));
  }
  pull(2, true);
  EXPECT_NO_THROW(trigger.fire());
}

TEST_F(GpioTriggerTest, AMissingStrobeIsSaid) {
  GpioTriggerOptions options{.trigger = line(1)};
  options.strobe = line(4);
  options.timeout = Seconds(0.3);
  GpioTrigger trigger(options);
  try {
    trigger.fire();
    ADD_FAILURE() << "there was no strobe";
  } catch (const DeviceError& error) {
    EXPECT_THAT(error.what(), HasSubstr("no strobe"));
  }
}

TEST_F(GpioTriggerTest, ALineInUseIsRefusedByName) {
  const GpioTrigger mine({.trigger = line(1)});
  try {
    GpioTrigger trigger({.trigger = line(1)});
    ADD_FAILURE() << "the line was taken";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.error_number(), EBUSY);
    EXPECT_THAT(error.what(), HasSubstr("used by refield"));
  }
  EXPECT_THROW(GpioTrigger({.trigger = line(99)}), InputError);
  EXPECT_THROW(GpioTrigger({.trigger = {"no-such-chip", 1}}), DeviceError);
}

TEST_F(GpioTriggerTest, AnUnpluggedChipIsSaidAndAPluggedOneWorksAgain) {
  {
    GpioTriggerOptions options{.trigger = line(1)};
    options.ready = line(2);
    GpioTrigger trigger(options);
    pull(2, true);
    trigger.fire();
    unplug();
    EXPECT_THROW(trigger.fire(), DeviceError);
  }
  write_file(std::string(config) + "/live", "1");
  plugged_ = true;
  GpioTrigger again({.trigger = line(1)});
  EXPECT_NO_THROW(again.fire());
}

}  // namespace
}  // namespace refield
