// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "core/base/units.h"

namespace refield {

/// How the samples of a raw frame lie on the sensor.
enum class PixelLayout { grey, rgb, bayer_rggb, bayer_grbg, bayer_gbrg, bayer_bggr };

/// In the order of PixelLayout.
inline constexpr std::array<const char*, 6> layout_names = {"grey",       "rgb",        "bayer_rggb",
                                                            "bayer_grbg", "bayer_gbrg", "bayer_bggr"};

constexpr const char* layout_name(PixelLayout layout) {
  return layout_names[static_cast<std::size_t>(layout)];
}

constexpr bool is_bayer(PixelLayout layout) {
  return layout != PixelLayout::grey && layout != PixelLayout::rgb;
}

/// Channel that a Bayer sensor's site (x, y) measures: 0 red, 1 green, 2 blue. The layout's letters name the
/// sites (0, 0), (1, 0), (0, 1), (1, 1).
constexpr int bayer_channel(PixelLayout layout, int x, int y) {
  const bool red_right = layout == PixelLayout::bayer_grbg || layout == PixelLayout::bayer_bggr;
  const bool red_below = layout == PixelLayout::bayer_gbrg || layout == PixelLayout::bayer_bggr;
  return ((x & 1) ^ int{red_right}) + ((y & 1) ^ int{red_below});
}

struct CameraDescription {
  std::string name;
  int width = 0;
  int height = 0;
  PixelLayout layout = PixelLayout::rgb;
  int bits = 12;  ///< of a sample; full scale is 2^bits − 1
  Seconds shortest_exposure{0};
  Seconds longest_exposure{0};
  Seconds frame_interval{0};
  Seconds exposure_step{0};          ///< exposures are whole multiples of it; 0: any are
  std::vector<Seconds> exposures{};  ///< the only ones that there are, in growing order; empty: see above
  /// Each frame is a photograph that is taken on request (a DSLR): its time stamp is too early by a shutter
  /// lag that varies, which is enough to pair it with a pattern, not to measure how light changes.
  bool takes_photographs = false;
};

/// One frame as the sensor gave it.
struct RawFrame {
  int width = 0;
  int height = 0;
  PixelLayout layout = PixelLayout::rgb;
  std::vector<std::uint16_t>
      samples;  ///< [height × width × 3] for rgb, [height × width] otherwise; top row first
  TimePoint exposure_start{};
  Seconds exposure{0};
  double gain = 1.0;           ///< amplification that was in effect, unitless
  std::uint64_t sequence = 0;  ///< consecutive; a gap means lost frames
};

/// A camera that streams frames. Settings act on frames that begin after the call; how many more still have
/// the old ones is the camera's control latency, which 'refield acquire calibrate' measures.
/// RawFrame::exposure and gain are what the driver says; within the control latency that may be what was
/// asked for, not what was.
class Camera {
 public:
  virtual ~Camera() = default;
  virtual CameraDescription describe() const = 0;
  /// Returns the instant at which the device took the settings, on the clock of RawFrame::exposure_start.
  /// Throws InputError outside the camera's range, DeviceError when the device refuses.
  virtual TimePoint set_exposure(Seconds exposure, double gain) = 0;
  /// Frames whose exposure begins earlier will not be used: a camera that takes photographs waits until then.
  virtual void begin_after(TimePoint /*earliest*/) {}
  /// Waits for the next frame. Throws DeviceError on a time-out or an unplugged camera.
  virtual RawFrame next_frame(Seconds timeout) = 0;
};

/// A line that starts a camera's exposure.
class Trigger {
 public:
  virtual ~Trigger() = default;
  /// Sends one pulse and returns the instant of its active edge. Throws DeviceError when the line is gone.
  virtual TimePoint fire() = 0;
};

}  // namespace refield
