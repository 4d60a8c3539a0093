// SPDX-License-Identifier: Apache-2.0
// The laboratory between the kernel's virtual monitor and its virtual camera: reads back what the monitor
// shows, lets the scene of a recipe answer to it and a sensor expose it, and hands the frames, late by 0 to 4
// of them at random, to the camera. usage: virtual_lab TRUTH RECIPE CARD OUTPUT_NODE CAMERA_NODE LOG [steady]
// LOG and "steady" as LabScene says. LAB_SCREEN in the environment: the monitor's mode, if it is not 640x480.
#include <linux/videodev2.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <optional>
#include <thread>

#include "acquire/devices/v4l2_device.h"
#include "core/base/errors.h"
#include "core/base/rng.h"
#include "tests/devices/lab_scene.h"
#include "tests/devices/screen_reader.h"
#include "tests/devices/video_output.h"

namespace refield::test {
namespace {

constexpr int output_width = 640, output_height = 480;
constexpr int longest_delay = 4;  // frames

TimePoint now() {
  return TimePoint(std::chrono::steady_clock::now().time_since_epoch());
}

/// The drive levels on the screen: one of each texel's pixels, which must all be equal.
DriveImage drive_of(const Screen& screen, int width, int height) {
  DriveImage drive{width, height, {}};
  const int scale = std::min(screen.width / width, screen.height / height);
  const int left = (screen.width - width * scale) / 2, top = (screen.height - height * scale) / 2;
  const auto pixel = [&](int x, int y) {
    return screen.pixels[static_cast<std::size_t>(y) * screen.width + x] & 0xffffffu;
  };
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const std::uint32_t value = pixel(left + x * scale, top + y * scale);
      for (int j = 0; j < scale; ++j)
        for (int i = 0; i < scale; ++i)
          if (pixel(left + x * scale + i, top + y * scale + j) != value) {
            std::fprintf(stderr, "## FAILED: the screen is not pixel-exact at texel %d, %d\n", x, y);
            std::_Exit(1);
          }
      for (int shift : {16, 8, 0}) drive.levels.push_back(static_cast<std::uint8_t>(value >> shift));
    }
  return drive;
}

struct Frame {
  std::vector<std::uint16_t> samples;
  TimePoint stamp;
};

/// The camera's controls as they stand; the last ones while it is gone.
class CameraSettings {
 public:
  explicit CameraSettings(std::string camera) : node_(std::move(camera)) {}

  std::pair<Seconds, double> now() {
    v4l2_control exposure{V4L2_CID_EXPOSURE_ABSOLUTE, 0}, gain{V4L2_CID_GAIN, 0};
    try {
      if (!camera_) camera_.emplace(node_);
      camera_->call(VIDIOC_G_CTRL, &exposure, "tells no exposure");
      camera_->call(VIDIOC_G_CTRL, &gain, "tells no gain");
      settings_ = {Seconds(exposure.value * 1e-4), gain.value / 100.0};
    } catch (const DeviceError&) {
      camera_.reset();
    }
    return settings_;
  }

 private:
  std::string node_;
  std::optional<V4l2Device> camera_;
  std::pair<Seconds, double> settings_{0.01, 1.0};
};

void run(char** arguments, bool steady) {
  LabScene scene(arguments[1], arguments[2], arguments[6], steady);
  CameraSettings settings(arguments[5]);
  int screen_width = 640, screen_height = 480;
  if (const char* mode = std::getenv("LAB_SCREEN"))
    if (std::sscanf(mode, "%dx%d", &screen_width, &screen_height) != 2) throw InputError(mode);
  ScreenReader reader("refield", arguments[3], screen_width, screen_height);
  std::optional<VideoOutput> output;
  const auto [width, height, parameterisation] = scene.domain();
  const DriveImage dark{width, height, std::vector<std::uint8_t>(std::size_t{3} * width * height)};
  const auto shown = [&] {
    const auto screen = reader.read();
    if (!screen) std::this_thread::sleep_for(std::chrono::milliseconds(20));
    return screen ? drive_of(*screen, width, height) : dark;
  };
  Rng random(4);
  std::deque<Frame> late;
  // A frame's stamp lies before the first look at the screen, and a look closes it that finds the same
  // pattern: so a frame whose stamp is later than a flip has seen the new pattern alone.
  TimePoint start = now();
  DriveImage before = shown();
  while (true) {
    const auto [exposure, gain] = settings.now();
    std::this_thread::sleep_until(std::chrono::steady_clock::time_point(
        (start + std::chrono::ceil<std::chrono::nanoseconds>(exposure)).time_since_epoch()));
    const TimePoint next = now();
    DriveImage after = shown();
    late.push_back({scene.expose(before, after, start, exposure, gain), start});
    const auto delay = static_cast<std::size_t>(random.uniform() * (longest_delay + 1));
    for (; late.size() > delay; late.pop_front()) try {
        if (!output) output.emplace(arguments[4], V4L2_PIX_FMT_SRGGB12, output_width, output_height);
        output->send(late.front().samples, scene.columns(), late.front().stamp);
      } catch (const DeviceError&) {  // vivid's faults strike its output, too: this frame is lost
        output.reset();
      }
    start = next;
    before = std::move(after);
  }
}

}  // namespace
}  // namespace refield::test

int main(int argc, char** argv) {
  const bool steady = argc == 8 && argv[7] == std::string("steady");
  if (argc != 7 && !steady) return 2;
  try {
    refield::test::run(argv, steady);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "## FAILED: virtual_lab: %s\n", error.what());
  }
  return 1;
}
