// SPDX-License-Identifier: Apache-2.0
#include "acquire/capture/capture.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <functional>

#include "acquire/hdr/bracket_files.h"
#include "acquire/hdr/hdr_merge.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "tests/acquire/fake_rig.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

namespace fs = std::filesystem;
using test::FakeRig;
using test::FakeRigHabits;
using test::TemporaryFolder;

// The fake camera rounds to a DN of 1e-5 / exposure; the longest exposure that most pixels keep is 20 ms.
constexpr float quantisation = 5e-4f;

class CaptureTest : public ::testing::Test {
 protected:
  CaptureTest() {
    create_folders(folder / "lights");
    for (int i = 0; i < 5; ++i) {
      Image light(FakeRig::width, FakeRig::height, 3);
      for (std::size_t k = 0; k < light.values.size(); ++k)
        light.values[k] = static_cast<float>((k * 7 + i * 5) % 11) / 11.0f;
      const std::string name = "light_" + std::to_string(i);
      write_exr(folder / "lights" / (name + ".exr"), light);
      lights.push_back(
          {name, i < 3 ? FrameRole::train : FrameRole::test, "natural", folder / "lights" / (name + ".exr")});
    }
  }

  CaptureRequest request(const fs::path& session, IfExists if_exists = IfExists::refuse) const {
    CaptureRequest request;
    request.folder = folder / session;
    request.lights = lights;
    request.camera = FakeRig().camera_calibration();
    request.monitor = FakeRig().monitor_calibration();
    request.rig = "fake";
    request.exposures = {Seconds(0.005), Seconds(0.02), Seconds(0.08)};
    request.if_exists = if_exists;
    return request;
  }

  static CaptureSummary run(const CaptureRequest& request, FakeRigHabits habits = {}) {
    FakeRig rig(habits);
    return capture(request, rig.camera(), rig.illuminator(), nullptr);
  }

  /// Every file of both folders, byte by byte.
  static void expect_equal_folders(const fs::path& a, const fs::path& b) {
    const auto list = [](const fs::path& root) {
      std::vector<fs::path> files;
      for (const auto& entry : fs::recursive_directory_iterator(root))
        if (entry.is_regular_file()) files.push_back(entry.path().lexically_relative(root));
      std::ranges::sort(files);
      return files;
    };
    ASSERT_EQ(list(a), list(b));
    for (const fs::path& file : list(a)) EXPECT_TRUE(read_text(a / file) == read_text(b / file)) << file;
  }

  TemporaryFolder folder;
  std::vector<CaptureLight> lights;
};

TEST_F(CaptureTest, PhotographsAreTransportTimesEmittedLight) {
  run(request("session"));
  const CaptureSession session = read_capture_session(folder / "session");
  ASSERT_EQ(session.frames.size(), 5u);
  EXPECT_EQ(session.frames[4].role, FrameRole::test);
  EXPECT_EQ(session.width, FakeRig::width);
  const FakeRig rig;
  for (const CaptureFrame& frame : session.frames) {
    const Image light = read_image(frame.illumination);
    const Photograph observed = read_photograph(frame.observed);
    for (int y = 0; y < FakeRig::height; ++y)
      for (int x = 0; x < FakeRig::width; ++x)
        for (int c = 0; c < 3; ++c)
          EXPECT_NEAR(observed.radiance.at(x, y, c), rig.reflectance(x, y) * light.at(x, y, c), quantisation);
  }
  const Photograph ambient = read_photograph(*session.ambient);
  EXPECT_NEAR(ambient.radiance.at(0, 0, 0), FakeRig::ambient + 0.01f * rig.reflectance(0, 0), quantisation);
}

TEST_F(CaptureTest, BadTimingChangesNothing) {
  run(request("good"));
  FakeRigHabits habits;
  habits.latency = Seconds(0.12);
  habits.queue_frames = 5;
  habits.settings_delay = 4;
  habits.lose_every = 7;
  const auto summary = run(request("bad"), habits);
  EXPECT_GT(summary.discarded.early, 0u);
  EXPECT_GT(summary.discarded.stale, 0u);
  EXPECT_GT(summary.discarded.lost, 0u);
  expect_equal_folders(folder / "good", folder / "bad");
}

TEST_F(CaptureTest, ResumesAfterTheCameraFailedAtAnyFrame) {
  run(request("whole"));
  FakeRig counting;
  capture(request("count"), counting.camera(), counting.illuminator(), nullptr);
  for (int frames = 0; frames < counting.frames_delivered(); frames += 31) {
    FakeRigHabits habits;
    habits.unplugged_after = frames;
    const fs::path name = "cut_" + std::to_string(frames);
    EXPECT_THROW(run(request(name), habits), DeviceError);
    EXPECT_FALSE(fs::exists(folder / name / session_manifest_name));
    EXPECT_THROW(run(request(name)), InputError) << "must not be overwritten without being told";
    run(request(name, IfExists::resume));
    expect_equal_folders(folder / "whole", folder / name);
  }
}

TEST_F(CaptureTest, RepeatsDamagedPhotographs) {
  run(request("whole"));
  run(request("damaged"));
  fs::resize_file(folder / "damaged/observed/light_1.exr", 100);
  std::ofstream(folder / "damaged/illumination/light_3.exr") << "no image";
  const auto summary = run(request("damaged", IfExists::resume));
  EXPECT_EQ(summary.found_damaged, 2u);
  expect_equal_folders(folder / "whole", folder / "damaged");
}

TEST_F(CaptureTest, StopsTakingTrainingLightsWhenThereAreEnough) {
  const auto two_are_enough = [this](const fs::path& name, IfExists if_exists = IfExists::refuse) {
    CaptureRequest wanted = request(name, if_exists);
    wanted.stop_rule = "two";
    wanted.is_enough = [taken = 0](const CaptureFrame& frame) mutable {
      EXPECT_TRUE(fs::exists(frame.observed) && fs::exists(frame.illumination));
      return ++taken == 2;
    };
    return wanted;
  };
  const auto summary = run(two_are_enough("stopped"));
  EXPECT_EQ(summary.lights, 4u);
  EXPECT_EQ(summary.left_out, 1u);
  const CaptureSession session = read_capture_session(folder / "stopped");
  EXPECT_EQ(session.frames_of(FrameRole::train).size(), 2u);
  EXPECT_EQ(session.frames_of(FrameRole::test).size(), 2u);
  EXPECT_FALSE(fs::exists(folder / "stopped/observed/light_2.exr"));

  // Cut anywhere and resumed, it stops at the same place.
  for (const int frames : {3, 15, 25, 40}) {
    FakeRigHabits habits;
    habits.unplugged_after = frames;
    const fs::path name = "cut_" + std::to_string(frames);
    EXPECT_THROW(run(two_are_enough(name), habits), DeviceError);
    run(two_are_enough(name, IfExists::resume));
    expect_equal_folders(folder / "stopped", folder / name);
  }
  EXPECT_THROW(run(request("stopped", IfExists::resume)), InputError) << "all lights is another capture";
}

TEST_F(CaptureTest, RefusesToResumeAsAnotherCapture) {
  run(request("session"));
  const auto refused = [&](const std::function<void(CaptureRequest&)>& change) {
    CaptureRequest changed = request("session", IfExists::resume);
    change(changed);
    EXPECT_THROW(run(changed), InputError);
  };
  EXPECT_EQ(run(request("session", IfExists::resume)).useful_fraction.size(), 0u);  // complete: nothing to do
  refused([](auto& r) { r.rig = "other"; });
  refused([](auto& r) { r.exposures.pop_back(); });
  refused([](auto& r) { r.ambient_repeats = 3; });
  refused([](auto& r) { r.lights.pop_back(); });
  refused([](auto& r) { r.lights[0].role = FrameRole::test; });
  refused([](auto& r) { r.camera.read_noise_electrons = 1.0; });
  refused([](auto& r) { r.monitor.radiance_from_level[0][255] = 1.2f; });
  refused([](auto& r) { r.keep_raw = true; });
  write_exr(lights[0].wanted, Image(FakeRig::width, FakeRig::height, 3, 0.4f));
  refused([](auto&) {});
}

TEST_F(CaptureTest, MetersExposuresAndKeepsThemOnResume) {
  CaptureRequest metered = request("metered");
  metered.exposures.clear();
  metered.exposure_plan.count = 2;
  const auto summary = run(metered);
  ASSERT_EQ(summary.exposures.size(), 2u);
  // White on the brightest pixel: (0.89 · 1.01 + 0.05) · 1e5 DN a second, to four fifths of 4055 DN.
  EXPECT_NEAR(summary.exposures[0].count(), 0.8 * 4055 / ((0.89 * 1.01 + 0.05) * 1e5), 1e-3);
  EXPECT_EQ(summary.clipped_fraction, 0.0);

  FakeRigHabits habits;
  habits.unplugged_after = 60;
  metered.folder = folder / "cut";
  EXPECT_THROW(run(metered, habits), DeviceError);
  ASSERT_TRUE(fs::exists(folder / "cut/plan.toml")) << "the test must cut after metering";
  metered.if_exists = IfExists::resume;
  run(metered);
  expect_equal_folders(folder / "metered", folder / "cut");
}

TEST_F(CaptureTest, KeptRawFramesMergeToTheSamePhotograph) {
  CaptureRequest raw = request("raw");
  raw.keep_raw = true;
  raw.frames_per_exposure = 2;
  run(raw);
  std::vector<RawFrame> frames;
  for (std::size_t i = 0; i < raw.exposures.size(); ++i)
    for (int repeat = 0; repeat < 2; ++repeat) {
      const auto file = read_bracket_file(
          folder / "raw/raw" / ("light_2_e" + std::to_string(i) + "_r" + std::to_string(repeat) + ".png"));
      EXPECT_EQ(file.bits, 16);
      frames.push_back(file.frame);
      frames.back().exposure = raw.exposures[i];
    }
  Photograph merged = merge_exposures(frames, read_camera_calibration(folder / "raw/calibration.toml"));
  subtract_ambient(merged, read_photograph(folder / "raw/ambient.exr"));
  EXPECT_EQ(merged.radiance.values, read_photograph(folder / "raw/observed/light_2.exr").radiance.values);
}

TEST_F(CaptureTest, PaintedAndAutomaticMasks) {
  Image painted(FakeRig::width, FakeRig::height, 1);
  painted.at(2, 1, 0) = 1.0f;
  write_png(folder / "painted.png", painted);
  CaptureRequest with_painted = request("painted");
  with_painted.mask = {MaskSource::Kind::painted, folder / "painted.png"};
  run(with_painted);
  const auto mask =
      read_mask(*read_capture_session(folder / "painted").mask, FakeRig::width, FakeRig::height);
  EXPECT_EQ(std::ranges::count(mask, 1), 1);
  EXPECT_EQ(mask[FakeRig::width + 2], 1);

  CaptureRequest with_automatic = request("automatic");
  with_automatic.mask.kind = MaskSource::Kind::automatic;
  run(with_automatic);  // every pixel of the fake scene responds
  EXPECT_EQ(std::ranges::count(read_mask(folder / "automatic/mask.png", FakeRig::width, FakeRig::height), 1),
            24);
}

TEST(CaptureRequest, TakesMoreAmbientFramesTheMorePhotographsThereAre) {
  CaptureRequest request;
  const auto with = [&](int training, int test, int frames) {
    request.lights.assign(static_cast<std::size_t>(training), {});
    for (int i = 0; i < test; ++i) request.lights.emplace_back().role = FrameRole::test;
    request.frames_per_exposure = frames;
    return request.ambient_count();
  };
  EXPECT_EQ(with(1, 0, 1), 4);
  EXPECT_EQ(with(40, 100, 1), 5);
  EXPECT_EQ(with(180, 0, 1), 22);
  EXPECT_EQ(with(180, 0, 2), 45);
  EXPECT_EQ(with(5000, 0, 1), 64);
  request.ambient_repeats = 3;
  EXPECT_EQ(with(180, 0, 2), 3);
}

TEST_F(CaptureTest, RefusesUnusableRequestsBeforeWriting) {
  const auto refused = [&](const std::function<void(CaptureRequest&)>& change) {
    CaptureRequest changed = request("never");
    change(changed);
    EXPECT_THROW(run(changed), Error);
    EXPECT_FALSE(fs::exists(folder / "never"));
  };
  write_exr(folder / "small.exr", Image(2, 2, 3, 0.1f));
  write_text_atomically(folder / "text.exr", "no image");
  refused([](auto& r) { r.lights.clear(); });
  refused([](auto& r) { r.lights[1].name = "light_0"; });
  refused([](auto& r) { r.lights[1].name = "ambient"; });
  refused([](auto& r) { r.lights[1].name = "../outside"; });
  refused([&](auto& r) { r.lights[1].wanted = folder / "small.exr"; });
  refused([&](auto& r) { r.lights[1].wanted = folder / "text.exr"; });
  refused([&](auto& r) { r.lights[1].wanted = folder / "missing.exr"; });
  refused([](auto& r) { r.exposures = {Seconds(100.0)}; });
  refused([](auto& r) {
    r.camera.bits = 10;
    r.camera.linear_from_dn = linear_response(10);
    r.camera.saturation_dn = 1023;
  });
  refused([](auto& r) { r.ambient_repeats = -1; });
  refused([](auto& r) { r.ambient_repeats = 65; });  // more than anyone means
  Image broken(FakeRig::width, FakeRig::height, 3, 0.5f);
  broken.at(3, 2, 1) = std::nanf("");
  write_exr(folder / "nan.exr", broken);
  refused([&](auto& r) { r.lights[4].wanted = folder / "nan.exr"; });
  fs::copy_file(lights[0].wanted, folder / "cut.exr");
  fs::resize_file(folder / "cut.exr", fs::file_size(folder / "cut.exr") - 40);
  refused([&](auto& r) { r.lights[4].wanted = folder / "cut.exr"; });
  write_png(folder / "small.png", Image(2, 2, 1, 1.0f));
  refused([&](auto& r) { r.mask = {MaskSource::Kind::painted, folder / "small.png"}; });
  refused([&](auto& r) { r.mask = {MaskSource::Kind::automatic, folder / "small.exr"}; });
}

}  // namespace
}  // namespace refield
