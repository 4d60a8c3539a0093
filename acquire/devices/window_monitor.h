// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>

#include "acquire/illuminator.h"

namespace refield {

struct WindowMonitorOptions {
  int display = 0;  ///< which monitor of the desktop, from 0; window_displays() lists them
  /// Size of the light maps, texels; 0: the display's. Each texel is shown as a square of whole pixels, the
  /// largest that fits, the picture in the middle and black around it. Nothing is ever interpolated.
  int width = 0;
  int height = 0;
};

/// A monitor of the desktop, as the window system names it.
struct WindowDisplay {
  std::string name;
  int width = 0;  ///< pixels
  int height = 0;
  double refresh_hz = 0.0;  ///< 0: not known
};

/// What someone at the keyboard wants of a window monitor.
enum class WindowKey {
  next,   ///< space, arrow right or down
  back,   ///< arrow left or up, backspace
  pause,  ///< P
  stop    ///< Escape, Q
};

/// Throws DeviceError where there is no desktop.
std::vector<WindowDisplay> window_displays();

/// A monitor inside a desktop: a full-screen window without frame or pointer (GLFW), for people who cannot
/// give a whole screen to DrmMonitor.
///
/// Levels are sent as they are, one texel to a square of whole pixels, without blending, filtering or a
/// colour table. X11's screen saver is held off; a desktop's own must be turned off. A window system that
/// composes may show a picture one or two refreshes after it was handed over, and may apply a colour profile
/// of its own: turn night light and profiles off, and let calibration measure latency and tone curve. The
/// time stamp is taken when the swap that waits for the vertical blanking returns, by CLOCK_MONOTONIC.
/// describe() says 0 for latency and settling. Only one window monitor exists at a time, and it is used by
/// the thread that made it.
class WindowMonitor final : public Illuminator {
 public:
  /// Throws InputError for a display or size that is not there, DeviceError without a desktop or OpenGL 3.0.
  explicit WindowMonitor(const WindowMonitorOptions& options);
  ~WindowMonitor() override;

  IlluminatorDescription describe() const override;
  /// Also throws DeviceError when the window was closed.
  TimePoint show(const DriveImage& image) override;

  /// Keys pressed in the window since the last call; what was covered is drawn again. Throws DeviceError when
  /// the window was closed.
  std::vector<WindowKey> keys();

  /// Side of the square that a texel is shown as, pixels.
  int pixels_per_texel() const;
  /// Whether frames were found to wait for the vertical blanking; false under a display that cannot (a remote
  /// or virtual one).
  bool waits_for_blanking() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace refield
