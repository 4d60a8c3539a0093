// SPDX-License-Identifier: Apache-2.0
#include "acquire/devices/pixel_formats.h"
#include "acquire/devices/tethered_camera.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <numeric>

#include "acquire/devices/v4l2_device.h"
#include "core/base/errors.h"
#include "tests/devices/lab.h"

namespace refield {
namespace {

using namespace test;

constexpr Seconds patience{600};  // ends what hangs

TEST(V4l2Device, ListsWhatVividOffers) {
  const V4l2Identity camera = find_v4l2_camera("vivid");
  EXPECT_EQ(camera.bus, "platform:vivid-000");
  EXPECT_EQ(find_v4l2_camera(camera.node).card, "vivid");
  const V4l2Device device(camera.node);
  const auto formats = formats_of(device);
  for (const char* name : {"GREY", "Y10", "Y12", "Y16", "RGGB", "BA81", "YUYV", "RGB3"}) {
    const auto found = std::ranges::find(formats, fourcc_from_text(name), &V4l2FormatInfo::fourcc);
    ASSERT_NE(found, formats.end()) << name;
    ASSERT_FALSE(found->sizes.empty()) << name;
    EXPECT_FALSE(found->sizes.front().rates.empty()) << name;
  }
  const auto controls = controls_of(device);
  const auto gain = std::ranges::find(controls, "gain", &V4l2ControlInfo::name);
  ASSERT_NE(gain, controls.end());
  EXPECT_EQ(gain->highest, 255);
  EXPECT_THROW(find_v4l2_camera("no such camera"), InputError);
  EXPECT_THROW(find_v4l2_camera("/dev/null"), InputError);
}

TEST(V4l2Camera, SwitchesAutomaticModesOffAndSaysWhatIsMissing) {
  set_vivid("gain_automatic", 1);
  const auto controls = [] {
    const auto camera = open_camera(vivid_options());
    return controls_of(V4l2Device(vivid_node()));
  }();
  EXPECT_EQ(std::ranges::find(controls, "gain_automatic", &V4l2ControlInfo::name)->value, 0);

  auto options = vivid_options();
  options.fixed_exposure = Seconds(0);
  EXPECT_THROW(open_camera(options), InputError);  // vivid has no exposure control
}

TEST(V4l2Camera, ControlsAreSetAndReadBack) {
  auto options = vivid_options();
  options.controls = {{"brightness", 77}, {"contrast", 3}};
  {
    const auto camera = open_camera(options);
    const auto controls = controls_of(V4l2Device(vivid_node()));
    EXPECT_EQ(std::ranges::find(controls, "brightness", &V4l2ControlInfo::name)->value, 77);
  }
  options.controls = {{"brightness", 999}};
  EXPECT_THROW(open_camera(options), InputError);
  options.controls = {{"brightnes", 1}};
  EXPECT_THROW(open_camera(options), InputError);
  set_vivid("brightness", 128);
  set_vivid("contrast", 128);
}

TEST(V4l2Camera, RefusesSizesAndFormatsThatItDoesNotHave) {
  auto options = vivid_options();
  options.width = 333;
  EXPECT_THROW(open_camera(options), InputError);
  options = vivid_options("NV12");
  EXPECT_THROW(open_camera(options), InputError);
  options = vivid_options();
  options.window = FrameWindow{300, 0, 100, 10};
  const auto camera = open_camera(options);
  EXPECT_THROW(camera->next_frame(patience), InputError);
}

class EveryFormat : public testing::TestWithParam<const char*> {};

TEST_P(EveryFormat, StreamsInOrder) {
  const auto begun = MonotonicClock::duration(std::chrono::steady_clock::now().time_since_epoch());
  const auto camera = open_camera(vivid_options(GetParam()));
  const CameraDescription description = camera->describe();
  std::optional<RawFrame> last;
  for (int i = 0; i < 8; ++i) {
    RawFrame frame = camera->next_frame(patience);
    EXPECT_EQ(frame.width, 320);
    EXPECT_EQ(frame.samples.size(), std::size_t{320} * 180 * (frame.layout == PixelLayout::rgb ? 3 : 1));
    EXPECT_LT(*std::ranges::max_element(frame.samples), 1u << description.bits);
    EXPECT_EQ(frame.layout, description.layout);
    if (last) {
      EXPECT_GE(frame.sequence, last->sequence) << "equal: expect_in_order()";
      EXPECT_GT(frame.exposure_start, last->exposure_start);
    }
    last = std::move(frame);
  }
  const auto done = MonotonicClock::duration(std::chrono::steady_clock::now().time_since_epoch());
  // Stamps of the end of frames are taken back by exposure and interval, less than .05 s.
  EXPECT_GT(last->exposure_start.time_since_epoch(), begun - std::chrono::seconds(1));
  EXPECT_LT(last->exposure_start.time_since_epoch(), done);
}
INSTANTIATE_TEST_SUITE_P(Formats, EveryFormat,
                         testing::Values("GREY", "Y10", "Y12", "Y16", "RGGB", "GRBG", "GBRG", "BA81", "RG10",
                                         "RG12", "RG16", "BYR2", "GB16", "GR16", "YUYV", "RGB3", "BGR3"));

/// Mean of each channel over the frame's middle third, as a share of full scale; Bayer sites by their colour.
std::array<double, 3> middle_colour(const RawFrame& frame, int bits) {
  std::array<double, 3> sum{}, count{};
  for (int y = frame.height / 3; y < 2 * frame.height / 3; ++y)
    for (int x = frame.width / 3; x < 2 * frame.width / 3; ++x) {
      const std::size_t pixel = static_cast<std::size_t>(y) * frame.width + x;
      for (int c = 0; c < 3; ++c) {
        if (is_bayer(frame.layout) && bayer_channel(frame.layout, x, y) != c) continue;
        sum[c] += frame.samples[frame.layout == PixelLayout::rgb ? 3 * pixel + c : pixel];
        count[c] += (1 << bits) - 1;
      }
    }
  return {sum[0] / count[0], sum[1] / count[1], sum[2] / count[2]};
}

// vivid's pure red: formats agree on it, whatever their packing and order of colours.
class PureRed : public testing::TestWithParam<const char*> {};

TEST_P(PureRed, IsRedInEveryFormat) {
  set_vivid("osd_text_mode", 2);
  set_vivid("test_pattern", 7);  // "100% Red"
  const auto camera = open_camera(vivid_options(GetParam()));
  const auto colour = middle_colour(camera->next_frame(patience), camera->describe().bits);
  constexpr double rounding = 0.02;  // of 8-bit colour conversion
  EXPECT_NEAR(colour[0], 1.0, rounding);
  EXPECT_NEAR(colour[1], 0.0, rounding);
  EXPECT_NEAR(colour[2], 0.0, rounding);
}
INSTANTIATE_TEST_SUITE_P(Formats, PureRed,
                         testing::Values("RGB3", "BGR3", "RGGB", "GRBG", "GBRG", "BA81", "RG10", "BG10",
                                         "RG12", "GB12", "RG16", "BYR2", "GR16", "YUYV"));

TEST(V4l2Camera, EndOfFrameStampsAreTakenBackToTheStart) {
  for (int is_start : {0, 1}) {
    set_vivid("timestamp_source", is_start);
    const auto camera = open_camera(vivid_options());
    const RawFrame frame = camera->next_frame(patience);
    const auto now = MonotonicClock::duration(std::chrono::steady_clock::now().time_since_epoch());
    const Seconds age = now - frame.exposure_start.time_since_epoch();
    // vivid's end-of-frame stamps lie nine tenths of an interval after its start-of-exposure ones; taken back
    // by exposure and interval, they must not come after them.
    EXPECT_GT(age.count(), is_start ? 0.0 : 0.01 + 0.1 * camera->describe().frame_interval.count());
  }
}

TEST(V4l2Camera, AWindowIsCutOutOfTheFrame) {
  set_vivid("osd_text_mode", 2);
  set_vivid("test_pattern", 0);  // colour bars
  auto options = vivid_options("Y16");
  const RawFrame whole = open_camera(options)->next_frame(patience);
  options.window = FrameWindow{100, 20, 60, 40};
  const RawFrame part = open_camera(options)->next_frame(patience);
  ASSERT_EQ(part.samples.size(), 60u * 40u);
  for (int y = 0; y < 40; ++y)
    for (int x = 0; x < 60; ++x)
      ASSERT_EQ(part.samples[60 * y + x], whole.samples[320 * (y + 20) + x + 100]) << x << ", " << y;
}

TEST(V4l2Camera, OneProgramAtATime) {
  const auto camera = open_camera(vivid_options());
  EXPECT_THROW(open_camera(vivid_options()), DeviceError);
}

}  // namespace
}  // namespace refield
