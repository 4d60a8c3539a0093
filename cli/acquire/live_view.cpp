// SPDX-License-Identifier: Apache-2.0
#include "cli/acquire/session_rig.h"

#include <poll.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>

#include "acquire/calibrate/bench.h"
#include "acquire/devices/monitors.h"
#include "acquire/hdr/hdr_merge.h"
#include "cli/run_context.h"
#include "core/image/tone_map.h"

namespace refield::cli {

namespace {

/// Energy of differences between neighbours of one colour relative to that of the image, per mille. It has no
/// meaning of its own: it is largest where the focus is best, whatever the exposure.
double sharpness_of(const RawFrame& frame) {
  const int step = is_bayer(frame.layout) ? 2 : 1, channels = frame.layout == PixelLayout::rgb ? 3 : 1;
  const auto at = [&](int x, int y) {
    return static_cast<double>(
        frame.samples[(static_cast<std::size_t>(y) * frame.width + x) * channels + channels / 2]);
  };
  double darkest = at(0, 0), differences = 0.0, energy = 0.0;
  for (int y = 0; y < frame.height; ++y)
    for (int x = 0; x < frame.width; ++x) darkest = std::min(darkest, at(x, y));
  for (int y = 0; y + step < frame.height; ++y)
    for (int x = 0; x + step < frame.width; ++x) {
      const double value = at(x, y);
      differences += std::pow(at(x + step, y) - value, 2) + std::pow(at(x, y + step) - value, 2);
      energy += std::pow(value - darkest, 2);
    }
  return energy > 0.0 ? 1000.0 * differences / energy : 0.0;
}

/// The share of full scale that the brightest hundredth of the samples reaches.
double brightness_of(const RawFrame& frame, const CameraDescription& camera) {
  return quantile_of({frame.samples.begin(), frame.samples.end()}, 0.99) / ((1 << camera.bits) - 1);
}

/// Whether Enter was pressed in the terminal, or a key in the monitor's window, which may cover it.
bool is_ended(Illuminator& monitor, int wait_ms) {
  if (auto* window = dynamic_cast<WindowMonitor*>(&monitor); window && !window->keys().empty()) return true;
  pollfd terminal{STDIN_FILENO, POLLIN, 0};
  if (::poll(&terminal, 1, wait_ms) != 1) return false;
  char line[256];
  [[maybe_unused]] const ssize_t count = ::read(STDIN_FILENO, line, sizeof line);
  return true;
}

/// Finds the exposure of a view: a factor of four per frame at most.
class AutoExposure {
 public:
  explicit AutoExposure(const CameraDescription& camera)
      : camera_(camera), exposure_(settable_exposure(Seconds(0.03), camera)) {}
  Seconds exposure() const { return exposure_; }
  /// Whether the exposure is another one now.
  bool follow(double brightness) {
    constexpr double target = 0.6, darkest = 0.35, brightest = 0.85;
    if (brightness > darkest && brightness < brightest) return false;
    const Seconds limit = std::min(camera_.longest_exposure, Seconds(1.0));
    const double factor = std::clamp(target / std::max(brightness, 1e-3), 0.25, 4.0);
    const Seconds next = settable_exposure(std::min(exposure_ * factor, limit), camera_);
    if (std::abs(next / exposure_ - 1.0) < 0.05) return false;
    exposure_ = next;
    return true;
  }

 private:
  CameraDescription camera_;
  Seconds exposure_;
};

/// A raw frame as an image, linear, of any unit; nothing about the camera needs to be known.
Image image_of(const RawFrame& frame, const CameraDescription& camera) {
  CameraCalibration assumed;
  assumed.bits = camera.bits;
  // Eight bits are gamma-encoded as a rule.
  assumed.linear_from_dn = camera.bits == 8 ? srgb_response(8) : linear_response(camera.bits);
  assumed.saturation_dn = (1 << camera.bits) - 1;
  return merge_exposures({&frame, 1}, assumed).radiance;
}

int draw(const RawFrame& frame, const CameraDescription& camera, Seconds exposure, double& best) {
  const int lines = print_image(image_of(frame, camera));
  const double sharpness = sharpness_of(frame);
  best = std::max(best, sharpness);
  std::printf(
      "   sharpness %.1f (best so far: %.1f), exposure %.3g s, brightest samples at %.0f %% of full "
      "scale\033[K\n",
      sharpness, best, exposure.count(), 100.0 * brightness_of(frame, camera));
  std::fflush(stdout);
  return lines + 1;
}

}  // namespace

int print_image(const Image& image) {
  winsize terminal{};
  int columns = 64;
  if (::ioctl(STDOUT_FILENO, TIOCGWINSZ, &terminal) == 0 && terminal.ws_col > 0)
    columns = std::clamp<int>(terminal.ws_col - 1, 8, 64);
  const int width = std::min(columns, image.width);
  const int height = std::max(
      2, static_cast<int>(std::lround(static_cast<double>(width) * image.height / image.width)) & ~1);
  const Image small = resample_area(image, width, height);
  const auto levels = tone_mapped(small, {exposure_to_white(small)});
  for (int y = 0; y < height; y += 2) {
    for (int x = 0; x < width; ++x) {
      const std::uint8_t* upper = &levels[3 * (static_cast<std::size_t>(y) * width + x)];
      const std::uint8_t* lower = upper + std::size_t{3} * width;
      std::printf("\033[38;2;%d;%d;%dm\033[48;2;%d;%d;%dm▀", upper[0], upper[1], upper[2], lower[0], lower[1],
                  lower[2]);
    }
    std::printf("\033[0m\033[K\n");
  }
  return height / 2;
}

void live_view(SessionRig& rig, double gain) {
  const CameraDescription camera = rig.camera().describe();
  const IlluminatorDescription monitor = rig.monitor().describe();
  AutoExposure automatic(camera);
  double best = 0.0;
  if (camera.takes_photographs) {
    CalibrationBench bench(rig.camera(), rig.monitor(), rig.trigger(), gain, Seconds(0.5));
    bench.show(255);
    constexpr int attempts = 6;
    for (int attempt = 1;; ++attempt) {
      const RawFrame frame = bench.frame(automatic.exposure(), run_context());
      if (automatic.follow(brightness_of(frame, camera)) && attempt < attempts) continue;
      draw(frame, camera, frame.exposure, best);
      return;
    }
  }
  rig.monitor().show(uniform_drive(monitor.width, monitor.height, 255));
  rig.camera().set_exposure(automatic.exposure(), gain);
  constexpr int settling_frames = 8;  // until a new exposure shows
  constexpr Seconds slack{5.0}, between_pictures{0.2};
  int lines = 0, frames = 0;
  auto drawn = std::chrono::steady_clock::now() - std::chrono::seconds(1);
  while (true) {
    run_context().throw_if_stopped();
    if (rig.trigger()) rig.trigger()->fire();
    const RawFrame frame = rig.camera().next_frame(camera.longest_exposure + slack);
    if (++frames % settling_frames == 0 && automatic.follow(brightness_of(frame, camera)))
      rig.camera().set_exposure(automatic.exposure(), gain);
    if (seconds_since(drawn) >= between_pictures.count()) {
      if (lines > 0) std::printf("\033[%dA", lines);
      lines = draw(frame, camera, frame.exposure, best);
      drawn = std::chrono::steady_clock::now();
    }
    constexpr int wait_ms = 5;
    if (is_ended(rig.monitor(), wait_ms)) return;
  }
}

}  // namespace refield::cli
