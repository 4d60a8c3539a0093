// SPDX-License-Identifier: Apache-2.0
// A capture with a DSLR and a virtual monitor, in a closed loop: the camera is libgphoto2's virtual one,
// which speaks PTP. It asks this program for each photograph, which draws what a sensor would see of the
// scene under the pattern that is on the monitor, after a shutter lag of 0 to 20 ms. The monitor changes its
// light 0 to 4 frames after it says that it did, at random. usage: gphoto_lab SHARE SESSION FAULT    SHARE
// holds truth/, recipe.toml, calibration.toml; SESSION is made or continued in it, and FAULT names its log.
// Exit status 0: complete; 3: stopped by the fault; 1: neither.
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <thread>

#include "acquire/calibrate/calibrate.h"
#include "acquire/capture/capture.h"
#include "acquire/devices/tethered_camera.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/rng.h"
#include "core/session/capture_session.h"
#include "tests/devices/lab_scene.h"
#include "tests/support/dng_file.h"

namespace refield::test {
namespace {

namespace fs = std::filesystem;

constexpr Seconds refresh{1.0 / 60.0};
constexpr int longest_delay = 4;  // of the monitor's light, refreshes
constexpr Seconds longest_lag{0.02};

// PTP response codes.
constexpr unsigned general_error = 0x2002, store_full = 0x200C;

TimePoint lab_now() {
  return TimePoint(std::chrono::steady_clock::now().time_since_epoch());
}

/// The last two patterns and when the light changes to the newer one; never is a third one of interest.
class SlowMonitor final : public Illuminator {
 public:
  SlowMonitor(int width, int height)
      : width_(width), height_(height), older_(uniform_drive(width, height, 0)) {
    newer_ = older_;
  }
  IlluminatorDescription describe() const override {
    return {"virtual monitor", width_, height_, longest_delay * refresh, Seconds(0)};
  }
  TimePoint show(const DriveImage& image) override {
    require_size(image, width_, height_, "virtual monitor");
    const TimePoint flip = lab_now();
    older_ = shown_at(flip);
    newer_ = image;
    change_ =
        flip + std::chrono::floor<std::chrono::nanoseconds>(random_.uniform() * longest_delay * refresh);
    return flip;
  }
  const DriveImage& shown_at(TimePoint t) const { return t < change_ ? older_ : newer_; }

 private:
  int width_, height_;
  DriveImage older_, newer_;
  TimePoint change_{};
  Rng random_{21};
};

/// What the camera's sensor sees, and what fails.
struct Laboratory {
  LabScene scene;
  SlowMonitor monitor;
  std::string fault;
  int width, height;
  Rng random{4};
  int photographs = 0;
  std::map<std::string, int> struck{};

  /// Whether the fault strikes, `times` times from the photograph with this number on.
  bool strikes(const char* name, int first, int times, const char* kind) {
    return fault == name && photographs >= first && struck[kind] < times && ++struck[kind] > 0;
  }

  unsigned event(const std::string& what, const char* file, unsigned shutter, unsigned aperture) {
    constexpr int for_good = 1'000'000;
    if (what == "cable")
      return strikes("unplugged", 30, for_good, "cable") || strikes("mended", 20, 6, "cable") ? 1 : 0;
    if (what == "download") return strikes("mended", 11, 4, "download") ? general_error : 0;
    if (strikes("full", 26, for_good, "store")) return store_full;
    ++photographs;
    const Seconds length(shutter * 1e-4);
    std::this_thread::sleep_for(random_lag());
    const TimePoint start = lab_now();
    if (fault == "killed" && photographs == 23) kill(getpid(), SIGKILL);
    std::this_thread::sleep_for(length);
    const DriveImage first = monitor.shown_at(start), second = monitor.shown_at(lab_now());
    const auto samples = scene.expose(first, second, start, length, 1.0);
    const double stated = fault == "automatic" ? 1.5 * length.count() : length.count();
    write_text_atomically(file, dng(static_cast<std::uint32_t>(width), static_cast<std::uint32_t>(height),
                                    samples, {0, 1, 1, 2}, stated, aperture * 0.01));
    return 0;
  }
  Seconds random_lag() { return random.uniform() * longest_lag; }
};

std::unique_ptr<Laboratory> laboratory;

int run(const fs::path& share, const std::string& session, const std::string& fault) {
  const CaptureSession truth = read_capture_session(share / "truth");
  const bool calibrates = fault == "calibrate";
  laboratory.reset(new Laboratory{{share / "truth", share / "recipe.toml",
                                   (share / (session + "_" + fault + ".log")).c_str(), !calibrates},
                                  {truth.light.width, truth.light.height},
                                  fault,
                                  truth.width,
                                  truth.height});
  RunContext context;
  context.on_note = [](const std::string& note) { std::printf("note: %s\n", note.c_str()); };
  GphotoCameraOptions options;
  options.controls = {{"f-number", "5.6"}};
  options.replug_patience = Seconds(fault == "mended" ? 30 : 0);
  const auto camera = open_camera(options, context);
  if (calibrates) {
    CalibrateOptions how;
    how.patience = longest_delay * refresh;
    how.tone_step = 51;
    const RigMeasurements rig = calibrate(*camera, laboratory->monitor, nullptr, how, context);
    write_calibration(share / "measured.toml", rig.camera, rig.monitor, rig.timing);
    std::printf(
        "## calibrated by %d photographs: black %.1f DN, saturation %.0f DN, superposition within %.2f %%\n",
        laboratory->photographs, rig.camera.black_level_dn, rig.camera.saturation_dn,
        100.0 * rig.superposition.largest_error());
    return 0;
  }
  CaptureRequest request;
  request.folder = share / session;
  for (const CaptureFrame& frame : truth.frames)
    request.lights.push_back({frame.name, frame.role, frame.kind, frame.illumination});
  request.camera = read_camera_calibration(share / "calibration.toml");
  request.monitor = read_monitor_calibration(share / "calibration.toml");
  request.exposures = exposures_of_plan(share / "rig1_session/plan.toml");
  if (fault == "lacking") request.exposures = {Seconds(0.005), Seconds(0.007), Seconds(0.02)};
  request.ambient_repeats = 1;  // noise follows from the pattern, so that repeats would all have the same
  request.rig = "laboratory";
  request.keep_raw = true;
  request.if_exists = IfExists::resume;
  const auto begun = std::chrono::steady_clock::now();
  const CaptureSummary summary = capture(request, *camera, laboratory->monitor, nullptr, context);
  const CameraTroubles& troubles = camera->troubles();
  std::printf(
      "## %s: %zu lights, %zu of them found, %d photographs in %.1f s; early %llu, stale %llu; damaged %llu, "
      "reconnected %llu\n",
      fault.c_str(), summary.lights, summary.found_done, laboratory->photographs, seconds_since(begun),
      static_cast<unsigned long long>(summary.discarded.early),
      static_cast<unsigned long long>(summary.discarded.stale),
      static_cast<unsigned long long>(troubles.damaged), static_cast<unsigned long long>(troubles.replugs));
  const bool none_wasted = summary.discarded.early + summary.discarded.stale == 0;
  if (!none_wasted) std::printf("## FAILED: photographs were taken that could not be used\n");
  return none_wasted ? 0 : 1;
}

}  // namespace
}  // namespace refield::test

/// Called by the camera's driver, see virtual_dslr.h.
extern "C" [[gnu::visibility("default")]] unsigned virtual_dslr_event(const char* event, const char* file,
                                                                      unsigned shutter, unsigned aperture) {
  return refield::test::laboratory ? refield::test::laboratory->event(event, file, shutter, aperture) : 0;
}

int main(int argc, char** argv) {
  if (argc != 4) return 2;
  try {
    return refield::test::run(argv[1], argv[2], argv[3]);
  } catch (const refield::Error& error) {
    std::printf("## %s: %s\n", argv[3], error.what());
    return 3;
  } catch (const std::exception& error) {
    std::printf("## FAILED: gphoto_lab: %s\n", error.what());
    return 1;
  }
}
