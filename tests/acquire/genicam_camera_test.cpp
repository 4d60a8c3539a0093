// SPDX-License-Identifier: Apache-2.0
// Cameras of Aravis, which speak the real GigE Vision protocol over the loopback interface.
#include "acquire/devices/tethered_camera.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cstring>
#include <mutex>
#include <thread>

#include "acquire/capture/exposure_plan.h"
#include "core/base/errors.h"
#include "tests/support/fake_genicam.h"
#include "tests/support/message_of.h"

namespace refield::test {
namespace {

using testing::AllOf;
using testing::HasSubstr;

class GenicamCameraTest : public testing::Test {
 protected:
  static void SetUpTestSuite() { network_is_private = enter_private_network(); }
  static inline bool network_is_private = false;
};

TimePoint clock_now() {
  return TimePoint(std::chrono::steady_clock::now().time_since_epoch());
}

/// What became of a camera's frames, by their number, which is drawn into them.
struct Exposed {
  std::mutex mutex;
  std::vector<TimePoint> starts;

  TimePoint start_of(const RawFrame& frame) {
    const std::lock_guard lock(mutex);
    return starts.at(frame.samples[0]);
  }
};

/// The time stamp of a frame may lie after its true start by what all frames so far were noticed late. This
/// measures that lateness, so that a busy machine widens the bound and does not break it.
class LatenessOfFrames {
 public:
  /// Call right after next_frame(). Returns the latest time stamp that the frame may have.
  TimePoint latest_start(TimePoint true_start, Seconds exposure) {
    // GenicamCamera allows for 20 ms until a frame is noticed.
    const Seconds late = clock_now() - true_start - exposure - Seconds(0.02);
    least_ = std::min(least_, std::max(late, Seconds(0)));
    return true_start + std::chrono::ceil<std::chrono::nanoseconds>(least_);
  }

 private:
  Seconds least_{1e9};
};

/// 16-bit grey: number of the frame, microseconds of exposure, decibels of gain times ten; exposes as long as
/// it says.
FakeDraw numbers(Exposed& exposed) {
  return [&exposed](const FakeExposure& exposure) {
    std::uint16_t number = 0;
    {
      const std::lock_guard lock(exposed.mutex);
      number = static_cast<std::uint16_t>(exposed.starts.size());
      exposed.starts.push_back(clock_now());
    }
    std::this_thread::sleep_for(std::chrono::microseconds(std::lround(exposure.microseconds)));
    const std::uint16_t samples[] = {number, static_cast<std::uint16_t>(std::lround(exposure.microseconds)),
                                     static_cast<std::uint16_t>(std::lround(10.0 * exposure.gain_db))};
    if (exposure.format == "Mono16") std::memcpy(exposure.bytes.data(), samples, sizeof samples);
  };
}

void nothing(const FakeExposure&) {}

constexpr Seconds patience(120);  // ends what hangs

GenicamCameraOptions options_of(const std::string& device = "127.0.0.1",
                                const std::string& format = "Mono16") {
  GenicamCameraOptions options;
  options.device = device;
  options.format = format;
  options.rate = 250.0;
  options.window = FrameWindow{0, 0, 64, 48};
  options.replug_patience = patience;
  return options;
}

TEST_F(GenicamCameraTest, FramesCarryTheirSettingsAndNeverBeginLaterThanTheyDid) {
  Exposed exposed;
  const FakeGenicam fake("127.0.0.1", "S1", numbers(exposed));
  const auto camera = open_camera(options_of());
  const CameraDescription description = camera->describe();
  EXPECT_THAT(description.name, HasSubstr("(S1)"));
  EXPECT_EQ(description.width, 64);
  EXPECT_EQ(description.height, 48);
  EXPECT_EQ(description.bits, 16);
  EXPECT_NEAR(description.frame_interval.count(), 0.004, 1e-5);
  std::uint64_t last = 0;
  LatenessOfFrames lateness;
  // 240 frames pass the end of the 16-bit ids, since this camera begins at 65 400. On a busy machine frames
  // are lost and incomplete, so that numbers have gaps; an id that goes round counts 65 535 frames where it
  // is misunderstood.
  for (int setting = 0; setting < 8; ++setting) {
    const Seconds exposure(0.001 + 0.0005 * (setting % 2));
    const double gain = setting % 2 ? 2.0 : 1.0;
    const TimePoint made = camera->set_exposure(exposure, gain);
    for (int i = 0; i < 30; ++i) {
      const RawFrame frame = camera->next_frame(patience);
      EXPECT_LE(frame.exposure_start, lateness.latest_start(exposed.start_of(frame), exposure));
      EXPECT_GT(frame.sequence, last);
      EXPECT_LT(frame.sequence - last, 30'000u);
      last = frame.sequence;
      if (frame.exposure_start < made) continue;
      EXPECT_EQ(frame.samples[1], std::lround(exposure.count() * 1e6));
      EXPECT_EQ(frame.samples[2], gain > 1.0 ? 60 : 0);
      EXPECT_NEAR(frame.gain, gain, 0.01 * gain);
    }
  }
  EXPECT_GT(last, 136u);
}

// This camera cuts off what is less than a microsecond, which of 29e-6 s must not make 28.
TEST_F(GenicamCameraTest, ShortExposuresAreMadeAsPlanned) {
  const FakeGenicam fake("127.0.0.1", "S1", nothing);
  const auto camera = open_camera(options_of());
  const CameraDescription description = camera->describe();
  for (double wanted = 20e-6; wanted < 120e-6; wanted += 0.9e-6) {
    const Seconds planned = settable_exposure(Seconds(wanted), description);
    EXPECT_NEAR(planned.count(), wanted, 0.51e-6);
    camera->set_exposure(planned, 1.0);
    EXPECT_NEAR(camera->next_frame(patience).exposure.count(), planned.count(), 1e-9);
  }
}

TEST_F(GenicamCameraTest, ReadsEveryPixelFormatOfTheCamera) {
  const auto draw = [](const FakeExposure& exposure) {
    // Samples 1, 2, 3, ... of 8 bits and more; the packed ones by hand: 1, 2, 3, 4 again and again.
    for (std::size_t i = 0; i < exposure.bytes.size(); ++i) {
      const std::uint8_t mono10p[] = {0x01, 0x08, 0x30, 0x00, 0x01};
      const std::uint8_t packed12[] = {0x00, 0x21, 0x00, 0x00, 0x43, 0x00};
      const bool is_16 =
          exposure.format == "Mono12" || exposure.format == "Mono16" || exposure.format == "BayerRG12";
      exposure.bytes[i] = exposure.format == "Mono10p"        ? mono10p[i % 5]
                          : exposure.format == "Mono12Packed" ? packed12[i % 6]
                          : is_16 ? static_cast<std::uint8_t>(i % 2 ? 0 : i / 2 % 4 + 1)
                                  : static_cast<std::uint8_t>(i % 4 + 1);
    }
  };
  const FakeGenicam fake("127.0.0.1", "S1", draw);
  struct Expected {
    const char* format;
    PixelLayout layout;
    int bits;
  };
  for (const Expected& expected : {Expected{"Mono8", PixelLayout::grey, 8},
                                   {"Mono12", PixelLayout::grey, 12},
                                   {"Mono16", PixelLayout::grey, 16},
                                   {"Mono10p", PixelLayout::grey, 10},
                                   {"Mono12Packed", PixelLayout::grey, 12},
                                   {"RGB8", PixelLayout::rgb, 8},
                                   {"BayerRG8", PixelLayout::bayer_rggb, 8},
                                   {"BayerGR8", PixelLayout::bayer_grbg, 8},
                                   {"BayerGB8", PixelLayout::bayer_gbrg, 8},
                                   {"BayerBG8", PixelLayout::bayer_bggr, 8},
                                   {"BayerRG12", PixelLayout::bayer_rggb, 12}}) {
    SCOPED_TRACE(expected.format);
    const auto camera = open_camera(options_of("127.0.0.1", expected.format));
    EXPECT_EQ(camera->describe().layout, expected.layout);
    EXPECT_EQ(camera->describe().bits, expected.bits);
    const RawFrame frame = camera->next_frame(patience);
    ASSERT_EQ(frame.samples.size(), 64u * 48u * (expected.layout == PixelLayout::rgb ? 3u : 1u));
    for (std::size_t i = 0; i < frame.samples.size(); ++i) ASSERT_EQ(frame.samples[i], i % 4 + 1) << i;
  }
  // Without a choice: raw, then the most bits.
  EXPECT_EQ(open_camera(options_of("127.0.0.1", ""))->describe().bits, 16);
}

TEST_F(GenicamCameraTest, SwitchesOffWhatTheCameraWouldChoose) {
  std::vector<std::string> notes;
  RunContext run;
  run.on_note = [&](const std::string& note) { notes.push_back(note); };
  const auto feature = [](const std::string& name) {
    const GenicamIdentity fake{"127.0.0.1", "", "", "", "S1", "GigEVision"};
    for (const GenicamFeature& found : abilities_of(fake).features)
      if (found.name == name) return found.value + " of " + found.limits;
    return std::string();
  };
  const FakeGenicam fake("127.0.0.1", "S1", nothing);
  EXPECT_EQ(feature("Gamma"), "0.45 of 0 to 4");
  {
    GenicamCameraOptions options = options_of();
    options.controls = {{"BlackLevel", "16"}, {"GainAuto", "Off"}};
    const auto camera = open_camera(options, run);
  }
  EXPECT_THAT(notes, testing::IsEmpty());
  EXPECT_EQ(feature("Gamma"), "1 of 0 to 4");
  EXPECT_EQ(feature("BlackLevel"), "16 of 0 to 255");
  EXPECT_EQ(feature("Gain"), "0 of 0 to 24 dB");
}

TEST_F(GenicamCameraTest, RefusesACameraThatKeepsChoosing) {
  const FakeGenicam fake("127.0.0.1", "S1", nothing, true);
  EXPECT_THAT(message_of<DeviceError>([] { const auto camera = open_camera(options_of()); }),
              AllOf(HasSubstr("keeps choosing by itself"), HasSubstr("ExposureAuto")));
}

TEST_F(GenicamCameraTest, TriggersBySoftwareOneFrameEach) {
  Exposed exposed;
  const FakeGenicam fake("127.0.0.1", "S1", numbers(exposed));
  GenicamCameraOptions options = options_of();
  options.trigger = "Software";
  const auto camera = open_camera(options);
  camera->set_exposure(Seconds(0.001), 1.0);
  const RawFrame first = camera->next_frame(patience);
  // A pause: a camera that runs freely makes 25 frames. A trigger whose frame came late or not is sent again.
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  const RawFrame second = camera->next_frame(patience);
  EXPECT_GT(second.samples[0], first.samples[0]);
  EXPECT_LE(second.samples[0], first.samples[0] + 4);
}

TEST_F(GenicamCameraTest, WaitsForItsTriggerLine) {
  const FakeGenicam fake("127.0.0.1", "S1", nothing);
  GenicamCameraOptions options = options_of();
  options.trigger = "Line0";
  EXPECT_THAT(message_of<DeviceError>([&] { open_camera(options)->next_frame(Seconds(0.3)); }),
              HasSubstr("no frame came within 0.3 s"));
  options.trigger = "Line7";
  EXPECT_THAT(message_of<InputError>([&] { const auto other = open_camera(options); }),
              AllOf(HasSubstr("trigger Line7 is refused"), HasSubstr("Line0, Software")));
}

TEST_F(GenicamCameraTest, SaysWhatItCannotDo) {
  const FakeGenicam fake("127.0.0.1", "S1", nothing);
  const auto message = [](GenicamCameraOptions options) {
    return message_of<InputError>([&] { const auto camera = open_camera(std::move(options)); });
  };
  EXPECT_THAT(message(options_of("127.0.0.1", "Mono14")),
              AllOf(HasSubstr("does not offer the pixel format Mono14"), HasSubstr("BayerBG8")));
  EXPECT_THAT(message(options_of("127.0.0.1", "YUV422_8")),
              HasSubstr("does not read the pixel format YUV422_8"));
  GenicamCameraOptions options = options_of();
  options.window = FrameWindow{0, 0, 50000, 480};
  EXPECT_THAT(message(options), HasSubstr("of 0, 0, 50000, 480"));
  options = options_of();
  options.rate = 1e5;
  EXPECT_THAT(message(options), AllOf(HasSubstr("frames per second"), HasSubstr("its range is")));
  options = options_of();
  options.controls = {{"BlackLevel", "300"}};
  EXPECT_THAT(message(options), AllOf(HasSubstr("BlackLevel = 300 is refused"), HasSubstr("0 to 255")));
  options.controls = {{"NoSuchFeature", "1"}};
  EXPECT_THAT(message(options), HasSubstr("feature NoSuchFeature is not there"));
  const auto camera = open_camera(options_of());
  EXPECT_THAT(message_of<InputError>([&] { camera->set_exposure(Seconds(100), 1.0); }),
              HasSubstr("an exposure in seconds of 100 lies outside 1e-05 to 10"));
  EXPECT_THAT(message_of<InputError>([&] { camera->set_exposure(Seconds(0.001), 100.0); }),
              HasSubstr("a gain of 100"));
}

TEST_F(GenicamCameraTest, SaysThatNobodyIsThere) {
  EXPECT_THAT(message_of<DeviceError>([] { const auto camera = open_camera(options_of("127.0.0.1")); }),
              AllOf(HasSubstr("genicam:127.0.0.1"), HasSubstr("cannot be opened")));
  EXPECT_THAT(message_of<InputError>([] { const auto camera = open_camera(options_of("S9")); }),
              AllOf(HasSubstr("camera 'genicam:S9': no camera has this name")));
}

TEST_F(GenicamCameraTest, TakesIncompleteFramesAgain) {
  Exposed exposed;
  FakeGenicam fake("127.0.0.1", "S1", numbers(exposed));
  fake.lose(0.05);
  for (const char* trigger : {"", "Software"}) {
    GenicamCameraOptions options = options_of();
    options.trigger = trigger;
    std::size_t notes = 0;
    RunContext run;
    run.on_note = [&](const std::string&) { ++notes; };
    const auto camera = open_camera(options, run);
    const Seconds exposure(0.001);
    camera->set_exposure(exposure, 1.0);
    LatenessOfFrames lateness;
    for (int i = 0; i < 40 || (camera->troubles().damaged == 0 && i < 4000); ++i) {
      const RawFrame frame = camera->next_frame(patience);
      EXPECT_LE(frame.exposure_start, lateness.latest_start(exposed.start_of(frame), exposure));
    }
    EXPECT_GT(camera->troubles().damaged, 0u) << trigger;
    EXPECT_EQ(notes, 1u) << "one note says enough";
  }
}

TEST_F(GenicamCameraTest, ComesBackAfterItWasUnplugged) {
  Exposed exposed;
  auto fake = std::make_unique<FakeGenicam>("127.0.0.1", "S1", numbers(exposed));
  std::atomic_flag missed;
  RunContext run;
  run.on_note = [&](const std::string& note) {
    if (note.find("does not answer") == std::string::npos) return;
    missed.test_and_set();
    missed.notify_one();
  };
  const auto camera = open_camera(options_of(), run);
  camera->set_exposure(Seconds(0.0015), 2.0);
  const RawFrame before = camera->next_frame(patience);
  fake.reset();
  std::thread plug([&] {
    missed.wait(false);
    fake = std::make_unique<FakeGenicam>("127.0.0.1", "S1", numbers(exposed));
  });
  RawFrame after = camera->next_frame(patience);
  while (camera->troubles().replugs == 0) after = camera->next_frame(patience);
  plug.join();
  EXPECT_GT(after.sequence, before.sequence);
  EXPECT_EQ(after.samples[1], 1500) << "its settings were made again";
  EXPECT_EQ(after.samples[2], 60);
}

TEST_F(GenicamCameraTest, SeveralCamerasAreNamedByTheirSerialNumbers) {
  if (!network_is_private) GTEST_SKIP() << "needs a network of its own, for a second address";
  Exposed one, two;
  const FakeGenicam first("127.0.0.1", "S1", numbers(one)), second("127.0.0.2", "S2", numbers(two));
  const auto left = open_camera(options_of("S1")), right = open_camera(options_of("S2"));
  left->set_exposure(Seconds(0.001), 1.0);
  right->set_exposure(Seconds(0.002), 1.0);
  for (int i = 0; i < 10; ++i) left->next_frame(patience), right->next_frame(patience);
  EXPECT_EQ(left->next_frame(patience).samples[1], 1000);
  EXPECT_EQ(right->next_frame(patience).samples[1], 2000);
  EXPECT_THAT(message_of<InputError>([] { const auto camera = open_camera(options_of("S3")); }),
              AllOf(HasSubstr("there are S1"), HasSubstr("S2")));
}

}  // namespace
}  // namespace refield::test
