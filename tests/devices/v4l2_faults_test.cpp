// SPDX-License-Identifier: Apache-2.0
// Every fault that vivid injects: what the camera makes of it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "acquire/devices/tethered_camera.h"
#include "acquire/devices/v4l2_device.h"
#include "core/base/errors.h"
#include "tests/devices/lab.h"

namespace refield {
namespace {

using namespace test;
using testing::HasSubstr;

constexpr Seconds patience{600};  // ends what hangs

std::vector<RawFrame> frames_of(TetheredCamera& camera, int count) {
  std::vector<RawFrame> frames;
  for (int i = 0; i < count; ++i) frames.push_back(camera.next_frame(patience));
  return frames;
}

/// Numbers may repeat: vivid counts frames by its clock, and where filling one takes longer than half a
/// frame, the next one gets its number. FramePairing drops such a frame.
void expect_in_order(const std::vector<RawFrame>& frames) {
  for (std::size_t i = 1; i < frames.size(); ++i) {
    EXPECT_GE(frames[i].sequence, frames[i - 1].sequence) << i;
    EXPECT_GT(frames[i].exposure_start, frames[i - 1].exposure_start) << i;
  }
}

class OpeningFault : public testing::TestWithParam<const char*> {};

TEST_P(OpeningFault, IsReportedAndTheNextAttemptWorks) {
  set_vivid(GetParam());
  try {
    const auto camera = open_camera(vivid_options());
    // A driver may also be in the middle of streaming when a buffer is refused; then it is started again.
    ADD_FAILURE() << "the fault went unseen";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.error_number(), EINVAL);
    EXPECT_THAT(error.what(), HasSubstr("/dev/video"));
  }
  const auto again = open_camera(vivid_options());
  expect_in_order(frames_of(*again, 3));
}
INSTANTIATE_TEST_SUITE_P(Vivid, OpeningFault,
                         testing::Values("inject_vidioc_reqbufs_error", "inject_vidioc_qbuf_error",
                                         "inject_vidioc_streamon_error"));

TEST(StreamingFault, ARefusedBufferCostsFramesButNoOrder) {
  const auto camera = open_camera(vivid_options());
  auto frames = frames_of(*camera, 3);
  set_vivid("inject_vidioc_qbuf_error");
  for (RawFrame& frame : frames_of(*camera, 4)) frames.push_back(std::move(frame));
  EXPECT_EQ(camera->troubles().restarts, 1u);
  expect_in_order(frames);
}

TEST(StreamingFault, ADamagedFrameIsLeftOut) {
  const auto camera = open_camera(vivid_options());
  auto frames = frames_of(*camera, 2);
  set_vivid("inject_v4l2_buf_flag_error");
  for (RawFrame& frame : frames_of(*camera, 6)) frames.push_back(std::move(frame));
  EXPECT_EQ(camera->troubles().damaged, 1u);
  expect_in_order(frames);
}

TEST(StreamingFault, AFatalErrorIsMendedByStartingAgain) {
  const auto camera = open_camera(vivid_options());
  auto frames = frames_of(*camera, 2);
  set_vivid("inject_fatal_streaming_error");
  for (RawFrame& frame : frames_of(*camera, 4)) frames.push_back(std::move(frame));
  EXPECT_EQ(camera->troubles().restarts, 1u);
  expect_in_order(frames);
}

TEST(StreamingFault, DroppedBuffersLeaveGapsInTheNumbering) {
  const auto camera = open_camera(vivid_options());
  frames_of(*camera, 1);
  set_vivid("percentage_of_dropped_buffers", 50);
  const auto frames = frames_of(*camera, 20);
  set_vivid("percentage_of_dropped_buffers", 0);
  expect_in_order(frames);
  EXPECT_GT(frames.back().sequence - frames.front().sequence, frames.size() - 1);
}

TEST(StreamingFault, NumbersThatWrapGoOn) {
  set_vivid("wrap_sequence_number", 1);
  {
    const auto camera = open_camera(vivid_options());
    const auto frames = frames_of(*camera, 40);
    expect_in_order(frames);
    EXPECT_LT(frames.back().sequence - frames.front().sequence, 1'000'000u) << "a round counts 4 294 967 296";
  }
  set_vivid("wrap_sequence_number", 0);
}

TEST(StreamingFault, AfterAPauseOfTheProgramTheSeriesGoesOn) {
  const auto camera = open_camera(vivid_options());
  auto frames = frames_of(*camera, 3);
  std::this_thread::sleep_for(std::chrono::seconds(1));  // the pause: 30 frames
  for (RawFrame& frame : frames_of(*camera, 3)) frames.push_back(std::move(frame));
  expect_in_order(frames);
}

class HdmiInput : public testing::Test {
 protected:
  // 640×480, a third of the pixels of 1280×720: an emulated machine fills them sooner.
  void SetUp() override { run("v4l2-ctl -d " + vivid_node() + " -i 3 --set-dv-bt-timings index=0"); }
  void TearDown() override { run("v4l2-ctl -d " + vivid_node() + " -i 0"); }
};

TEST_F(HdmiInput, LostSignalGivesNoFrame) {
  auto options = vivid_options();
  options.width = options.height = 0;
  options.rate = 0;
  {
    const auto camera = open_camera(options);
    EXPECT_EQ(frames_of(*camera, 2).back().width, 640);
    set_vivid("dv_timings_signal_mode", 1);
    // Frames from before may still come; then those without a signal, of which none is handed over.
    while (camera->troubles().damaged == 0) try {
        camera->next_frame(Seconds(0.2));
      } catch (const DeviceError&) {
      }
    EXPECT_THROW(camera->next_frame(Seconds(1)), DeviceError);
    set_vivid("dv_timings_signal_mode", 0);
    expect_in_order(frames_of(*camera, 2));
  }
  set_vivid("dv_timings_signal_mode", 1);
  EXPECT_THROW(open_camera(options)->next_frame(Seconds(1)), DeviceError);
  set_vivid("dv_timings_signal_mode", 0);
}

constexpr const char* driver = "/sys/bus/platform/drivers/vivid/";

TEST(Unplugged, ComesBackAndTheSeriesGoesOn) {
  std::atomic_flag missed;
  RunContext run;
  run.on_note = [&](const std::string& note) {
    if (note.find("does not answer") == std::string::npos) return;
    missed.test_and_set();
    missed.notify_one();
  };
  const auto camera = open_camera(vivid_options(), run);
  auto frames = frames_of(*camera, 3);
  std::thread person([&] {
    write_file(std::string(driver) + "unbind", "vivid.0");
    missed.wait(false);
    write_file(std::string(driver) + "bind", "vivid.0");
  });
  while (camera->troubles().replugs == 0) frames.push_back(camera->next_frame(patience));
  for (RawFrame& frame : frames_of(*camera, 5)) frames.push_back(std::move(frame));
  person.join();
  EXPECT_EQ(camera->troubles().replugs, 1u);
  expect_in_order(frames);
}

// vivid's own: every call fails until the last program has closed the node.
TEST(Unplugged, ADisconnectedDriverIsOpenedAgain) {
  const auto camera = open_camera(vivid_options());
  auto frames = frames_of(*camera, 3);
  set_vivid("disconnect");
  for (RawFrame& frame : frames_of(*camera, 10)) frames.push_back(std::move(frame));
  EXPECT_EQ(camera->troubles().replugs, 1u);
  expect_in_order(frames);
}

TEST(Unplugged, ForGoodIsSaidClearly) {
  auto options = vivid_options();
  options.replug_patience = Seconds(1);
  const auto camera = open_camera(options);
  frames_of(*camera, 2);
  write_file(std::string(driver) + "unbind", "vivid.0");
  try {
    frames_of(*camera, 1000);
    ADD_FAILURE() << "the camera was gone and gave frames";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.error_number(), ENODEV);
    EXPECT_THAT(error.what(), HasSubstr("unplugged"));
  }
  EXPECT_THROW(camera->next_frame(patience), DeviceError);
  EXPECT_THROW(camera->set_exposure(Seconds(0.01), 1.0), DeviceError);
  EXPECT_THROW(camera->describe(), DeviceError);
  write_file(std::string(driver) + "bind", "vivid.0");
}

}  // namespace
}  // namespace refield
