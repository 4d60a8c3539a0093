// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstddef>
#include <memory>

#include "acquire/illuminator.h"
#include "core/base/units.h"

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

struct DrmModeInfo {
  int width = 0;
  int height = 0;
  double refresh_hz = 0.0;
  bool is_preferred = false;

  std::string text() const;  ///< "1920x1080@60.00"
};

/// A place where a monitor can be plugged in.
struct DrmConnectorInfo {
  fs::path card;  ///< /dev/dri/card0
  std::string driver;
  std::string name;  ///< "HDMI-A-1"
  std::uint32_t id = 0;
  bool is_connected = false;
  std::vector<DrmModeInfo> modes;
};

/// Connectors of this machine's displays. Cards that may not be opened are left out.
std::vector<DrmConnectorInfo> find_drm_connectors();

/// The connector that `name` ("HDMI-A-1") or `card` and `name` name; empty: the first one with a monitor.
/// Throws InputError when there is none, listing those that are there, and DeviceError when no monitor is
/// plugged in.
DrmConnectorInfo find_drm_connector(const std::string& card, const std::string& name);

/// Place in `connector.modes` of `text`: "1920x1080", "1920x1080@60", or empty for the preferred one. Throws
/// InputError listing the modes.
std::size_t find_drm_mode(const DrmConnectorInfo& connector, const std::string& text);

struct DrmMonitorOptions {
  std::string card;       ///< "/dev/dri/card0"; empty: any
  std::string connector;  ///< "HDMI-A-1"; empty: the first one with a monitor
  std::string mode;       ///< "1920x1080@60"; empty: the monitor's preferred one
  /// Size of the light maps, texels; 0: the mode's. Each texel is shown as a square of whole pixels, the
  /// largest that fits, the picture in the middle and black around it. Nothing is ever interpolated.
  int width = 0;
  int height = 0;
};

/// A monitor driven full-screen, without a desktop, through Linux's DRM/KMS.
///
/// Two buffers are flipped; show() returns when the flip is done, with the time stamp of the vertical
/// blanking at which it took place. What is sent is exactly what was asked for: colour tables are switched
/// off, and the full range of levels is asked for. Latency and settling are those of the monitor behind the
/// cable: the driver does not know them, and describe() says 0; calibration measures them.
class DrmMonitor final : public Illuminator {
 public:
  /// Returns two seconds after the mode was set, when the monitor follows it.
  /// Throws InputError for a connector, mode or size that is not there, DeviceError when the card cannot be
  /// opened, another program (a desktop) holds it, its flips are not stamped by the monotonic clock, or no
  /// controller can drive the connector.
  explicit DrmMonitor(const DrmMonitorOptions& options);
  ~DrmMonitor() override;

  IlluminatorDescription describe() const override;
  /// Throws DeviceError when the monitor was unplugged or switched off, or the flip is not confirmed within
  /// two seconds.
  TimePoint show(const DriveImage& image) override;

  /// Side of the square that a texel is shown as, pixels.
  int pixels_per_texel() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace refield
