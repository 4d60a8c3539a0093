// SPDX-License-Identifier: Apache-2.0
// A capture with a GenICam camera and a virtual monitor, in a closed loop: the camera is Aravis' fake one, in
// a process of its own, speaks GigE Vision over the loopback interface, loses 2 % of its packets, and draws
// what a sensor would see of the scene under the pattern that is on the monitor. The monitor changes its
// light 0 to 4 frames after it says that it did, at random. The camera is killed and started again three
// times: at first the capture gives up and is resumed, later it waits. usage: genicam_lab SHARE    SHARE
// holds truth/, recipe.toml, calibration.toml; gets session/ and camera_*.log.
//        genicam_lab SHARE camera NUMBER    the camera's process
#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <thread>

#include "acquire/calibrate/calibration.h"
#include "acquire/capture/capture.h"
#include "acquire/devices/tethered_camera.h"
#include "core/base/errors.h"
#include "core/base/rng.h"
#include "core/session/capture_session.h"
#include "tests/devices/lab_scene.h"
#include "tests/support/fake_genicam.h"

namespace refield::test {
namespace {

namespace fs = std::filesystem;

constexpr const char* address = "127.0.0.1";
constexpr double lost_packets = 0.02;
constexpr double frame_rate = 200.0;
constexpr Seconds frame_interval{1.0 / frame_rate};
constexpr int longest_delay = 4;  // of the monitor's light, frames
constexpr std::size_t max_texels = 64 * 64;
constexpr int remembered_flips = 16;

TimePoint now() {
  return TimePoint(std::chrono::steady_clock::now().time_since_epoch());
}

/// The light of the monitor, in memory that both processes see: the last flips and when their light changes.
struct Screen {
  struct Flip {
    std::int64_t change_ns;
    std::uint8_t levels[3 * max_texels];
  };
  std::atomic<std::uint64_t> count{0};
  Flip flips[remembered_flips];

  /// Number of the pattern that gives light at an instant that has passed.
  std::uint64_t shown_at(TimePoint t) const {
    std::uint64_t last = count.load();
    while (last > 1 && flips[last % remembered_flips].change_ns > t.time_since_epoch().count()) --last;
    return last;
  }
};

Screen* map_screen(const fs::path& file) {
  const int descriptor = open(file.c_str(), O_RDWR | O_CREAT, 0600);
  if (descriptor < 0 || ftruncate(descriptor, sizeof(Screen)) != 0)
    throw std::runtime_error("no shared memory");
  void* memory = mmap(nullptr, sizeof(Screen), PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0);
  close(descriptor);
  if (memory == MAP_FAILED) throw std::runtime_error("no shared memory");
  return static_cast<Screen*>(memory);
}

class LabMonitor final : public Illuminator {
 public:
  LabMonitor(Screen& screen, int width, int height) : screen_(screen), width_(width), height_(height) {}
  IlluminatorDescription describe() const override {
    return {"virtual monitor", width_, height_, longest_delay * frame_interval, Seconds(0)};
  }
  TimePoint show(const DriveImage& image) override {
    require_size(image, width_, height_, "virtual monitor");
    const TimePoint flip = now();
    const std::uint64_t next = screen_.count.load() + 1;
    Screen::Flip& entry = screen_.flips[next % remembered_flips];
    const Seconds delay = random_.uniform() * longest_delay * frame_interval;
    entry.change_ns = (flip + std::chrono::floor<std::chrono::nanoseconds>(delay)).time_since_epoch().count();
    std::ranges::copy(image.levels, entry.levels);
    screen_.count = next;
    return flip;
  }

 private:
  Screen& screen_;
  int width_, height_;
  Rng random_{21};
};

[[noreturn]] void be_camera(const fs::path& share, const std::string& number) {
  const Screen* screen = map_screen(share / "screen");
  LabScene scene(share / "truth", share / "recipe.toml", (share / ("camera_" + number + ".log")).c_str(),
                 false);
  const auto [width, height, parameterisation] = scene.domain();
  const auto pattern = [&](std::uint64_t flip) {
    const std::uint8_t* levels = screen->flips[flip % remembered_flips].levels;
    return DriveImage{width, height, {levels, levels + std::size_t{3} * width * height}};
  };
  const auto draw = [&](const FakeExposure& exposure) {
    const TimePoint start = now();
    const Seconds length(exposure.microseconds * 1e-6);
    const TimePoint end = start + std::chrono::ceil<std::chrono::nanoseconds>(length);
    std::this_thread::sleep_until(std::chrono::steady_clock::time_point(end.time_since_epoch()));
    // No more than two patterns can have shone: the monitor's next one is shown after this one has stood.
    const auto samples = scene.expose(pattern(screen->shown_at(start)), pattern(screen->shown_at(end)), start,
                                      length, std::pow(10.0, exposure.gain_db / 20.0));
    if (exposure.format == "BayerRG12" && exposure.bytes.size() == 2 * samples.size())
      std::memcpy(exposure.bytes.data(), samples.data(), exposure.bytes.size());
  };
  FakeGenicam camera(address, "LAB", draw);
  camera.lose(lost_packets);
  while (true) pause();
}

/// The camera's process, which can be killed.
class CameraProcess {
 public:
  explicit CameraProcess(fs::path share) : share_(std::move(share)) { start(); }
  ~CameraProcess() { pull(); }
  void start() {
    const std::string number = std::to_string(++started_);
    std::string program = "/proc/self/exe", share = share_, word = "camera";
    std::string last = number;
    char* arguments[] = {program.data(), share.data(), word.data(), last.data(), nullptr};
    if (posix_spawn(&process_, program.c_str(), nullptr, nullptr, arguments, environ) != 0)
      throw std::runtime_error("the camera's process cannot be started");
    const fs::path log = share_ / ("camera_" + number + ".log");
    while (!fs::exists(log)) std::this_thread::sleep_for(std::chrono::milliseconds(10));
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  void pull() {
    kill(process_, SIGKILL);
    waitpid(process_, nullptr, 0);
  }

 private:
  fs::path share_;
  pid_t process_ = 0;
  int started_ = 0;
};

int run(const fs::path& share) {
  enter_private_network();
  fs::remove(share / "screen");
  Screen* screen = map_screen(share / "screen");
  CameraProcess process(share);
  const CaptureSession truth = read_capture_session(share / "truth");
  CaptureRequest request;
  request.folder = share / "session";
  for (const CaptureFrame& frame : truth.frames)
    request.lights.push_back({frame.name, frame.role, frame.kind, frame.illumination});
  request.camera = read_camera_calibration(share / "calibration.toml");
  request.monitor = read_monitor_calibration(share / "calibration.toml");
  request.exposures = exposures_of_plan(share / "rig1_session/plan.toml");
  request.rig = "laboratory";
  request.keep_raw = true;
  request.if_exists = IfExists::resume;
  const std::size_t quarter = request.lights.size() / 4;
  std::thread hand;
  std::size_t pulls = 0;
  request.before_light = [&](std::size_t place) {
    if (pulls >= 3 || place < (pulls + 1) * quarter) return;
    const bool for_good = pulls++ == 0;
    process.pull();
    if (for_good) return;
    if (hand.joinable()) hand.join();
    hand = std::thread([&] {
      std::this_thread::sleep_for(std::chrono::milliseconds(700));
      process.start();
    });
  };
  LabMonitor monitor(*screen, truth.light.width, truth.light.height);
  GenicamCameraOptions options;
  options.device = address;
  options.format = "BayerRG12";
  options.window = FrameWindow{0, 0, truth.width, truth.height};
  options.rate = frame_rate;
  options.replug_patience = Seconds(0);
  RunContext context;
  context.on_note = [](const std::string& note) { std::printf("note: %s\n", note.c_str()); };
  const auto begun = std::chrono::steady_clock::now();
  bool gave_up = false;
  try {
    const auto camera = open_camera(options, context);
    capture(request, *camera, monitor, nullptr, context);
  } catch (const DeviceError& error) {
    std::printf("## camera killed, no patience: %s\n", error.what());
    gave_up = true;
  }
  if (!gave_up) return std::printf("## FAILED: the capture did not notice that its camera was gone\n"), 1;
  process.start();
  options.replug_patience = Seconds(30);
  const auto camera = open_camera(options, context);
  const CaptureSummary summary = capture(request, *camera, monitor, nullptr, context);
  if (hand.joinable()) hand.join();
  std::printf(
      "## %zu photographs, %zu of them from before the first kill, in %.1f s; %llu incomplete frames, %llu "
      "reconnections; discarded: %llu early, %llu stale\n",
      summary.lights, summary.found_done, seconds_since(begun),
      static_cast<unsigned long long>(camera->troubles().damaged),
      static_cast<unsigned long long>(camera->troubles().replugs),
      static_cast<unsigned long long>(summary.discarded.early),
      static_cast<unsigned long long>(summary.discarded.stale));
  const bool as_planned = camera->troubles().replugs >= 2 && camera->troubles().damaged > 0;
  if (!as_planned) std::printf("## FAILED: at least two reconnections and some lost packets were expected\n");
  return as_planned ? 0 : 1;
}

}  // namespace
}  // namespace refield::test

int main(int argc, char** argv) {
  try {
    if (argc == 4) refield::test::be_camera(argv[1], argv[3]);
    return argc == 2 ? refield::test::run(argv[1]) : 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "## FAILED: genicam_lab: %s\n", error.what());
    return 1;
  }
}
