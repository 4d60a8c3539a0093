// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "acquire/illuminator.h"
#include "core/base/units.h"

namespace refield {

struct DrmModeInfo {
  int width = 0;
  int height = 0;
  double refresh_hz = 0.0;
  bool is_preferred = false;

  std::string text() const;  ///< "1920x1080@60.00"
};

/// A place where a monitor can be plugged in.
struct DrmConnectorInfo {
  std::filesystem::path card;  ///< /dev/dri/card0
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

/// The objects of KMS that a picture passes: plane, controller (CRTC), connector.
struct DrmPipeline {
  std::uint32_t connector = 0;
  std::uint32_t crtc = 0;
  std::uint32_t plane = 0;
  std::uint32_t mode_blob = 0;
  int width = 0;
  int height = 0;
};

/// The primary plane of the controller with that index; 0: there is none.
std::uint32_t primary_plane(int descriptor, std::uint32_t crtc_index);

/// Atomic commits; both return 0 or errno. The first sets the mode with a frame buffer over the whole screen,
/// colour tables off, full range of levels; the second flips to another buffer and has an event with `event`
/// sent.
int commit_mode(int descriptor, const DrmPipeline& pipeline, std::uint32_t frame_buffer);
int commit_flip(int descriptor, const DrmPipeline& pipeline, std::uint32_t frame_buffer, void* event);

/// A frame buffer of 8-bit XRGB in the card's memory that the processor can write ("dumb buffer").
struct DrmBuffer {
  std::uint32_t handle = 0;
  std::uint32_t frame_buffer = 0;
  std::size_t bytes_per_line = 0;
  std::span<std::uint8_t> bytes;
};

/// A display through Linux's KMS: one connector in one mode, whose frame buffers this program flips. By
/// atomic commits where the driver has them, else by the older calls. Colour tables are switched off and the
/// full range of levels is asked for, so that the monitor is sent what is in the buffer.
class DrmDevice {
 public:
  /// Throws DeviceError when the card cannot be opened, another program (a desktop) holds it, its flips are
  /// not stamped by the monotonic clock, or no controller can drive the connector.
  DrmDevice(const DrmConnectorInfo& connector, std::size_t mode);
  ~DrmDevice();
  DrmDevice(const DrmDevice&) = delete;
  DrmDevice& operator=(const DrmDevice&) = delete;

  bool is_atomic() const { return atomic_; }
  DrmBuffer make_buffer(int width, int height);
  /// Sets the mode with `buffer` on the screen.
  void light_up(const DrmBuffer& buffer);
  /// Puts `buffer` on the screen; returns when it is there, with the flip's time stamp. Throws DeviceError
  /// when the flip is not confirmed within two seconds.
  TimePoint flip(const DrmBuffer& buffer);
  /// Throws DeviceError when the monitor was unplugged or switched off.
  void require_monitor() const;

 private:
  [[noreturn]] void fail(int error_number, const std::string& what) const;
  void choose_objects();
  DrmConnectorInfo connector_;
  std::size_t mode_;
  int descriptor_ = -1;
  bool atomic_ = false;
  DrmPipeline pipeline_;
  std::vector<DrmBuffer> buffers_;
  std::optional<TimePoint> flipped_;  // the kernel holds its address while a flip is on its way
};

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
/// blanking at which it took place. What is sent is exactly what was asked for: levels are not scaled and no
/// colour table is applied. Latency and settling are those of the monitor behind the cable: the driver does
/// not know them, and describe() says 0; calibration measures them.
class DrmMonitor final : public Illuminator {
 public:
  /// Returns two seconds after the mode was set, when the monitor follows it.
  /// Throws InputError for a connector, mode or size that is not there, DeviceError as DrmDevice does.
  explicit DrmMonitor(const DrmMonitorOptions& options);
  ~DrmMonitor() override;

  IlluminatorDescription describe() const override;
  TimePoint show(const DriveImage& image) override;

  /// Side of the square that a texel is shown as, pixels.
  int pixels_per_texel() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace refield
