// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>
#include <string>

#include "acquire/illuminator.h"

namespace refield {

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
