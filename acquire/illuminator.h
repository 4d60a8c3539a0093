// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "core/base/errors.h"
#include "core/base/units.h"

namespace refield {

/// Drive levels for a display: not light, but what is sent to it. [height × width × 3], top row first.
struct DriveImage {
  int width = 0;
  int height = 0;
  std::vector<std::uint8_t> levels;
};

/// Throws InputError naming `display` when the pattern is not of that size.
inline void require_size(const DriveImage& image, int width, int height, const std::string& display) {
  if (image.width != width || image.height != height ||
      image.levels.size() != std::size_t{3} * width * height)
    throw InputError(display, ": a pattern of ", image.width, "×", image.height, " does not fit the ", width,
                     "×", height, " texels of the configured light maps");
}

struct IlluminatorDescription {
  std::string name;
  int width = 0;
  int height = 0;
  Seconds latency{0};   ///< from the flip's time stamp to the first changed light
  Seconds settling{0};  ///< from the first changed light to the last
};

/// Something that emits known light patterns: a monitor, a projector.
class Illuminator {
 public:
  virtual ~Illuminator() = default;
  virtual IlluminatorDescription describe() const = 0;
  /// Shows a pattern and returns the time stamp of the flip. Throws InputError for a wrong size, DeviceError
  /// when the display is gone. The light has fully changed `latency + settling` after the flip.
  virtual TimePoint show(const DriveImage& image) = 0;
};

}  // namespace refield
