// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <vector>

#include "acquire/illuminator.h"
#include "core/light_map.h"
#include "core/units.h"

namespace refield {

/// How a virtual monitor turns drive levels into light, and when.
struct MonitorModel {
  std::array<double, 3> gamma{2.2, 2.2, 2.2};  ///< exponent of each channel's tone curve
  double black_level = 0.002;                  ///< radiance at level 0, as a fraction of white_radiance
  double white_radiance = 1.0;                 ///< radiance at level 255, relative
  Seconds refresh_interval{1.0 / 60.0};        ///< a flip happens at a multiple of it
  Seconds latency{2.0 / 60.0};                 ///< from the flip's time stamp to the first changed light
  Seconds settling{0.012};  ///< from the first changed light to the last; linear in between

  double falloff =
      0.0;  ///< share by which the screen's corners are darker; grows with the square of the distance
  /// Dynamic dimming: a pattern of mean radiance m (as a fraction of white) is darker by the share dimming ·
  /// m, as OLED screens and backlights with a power limit do. Breaks superposition.
  double dimming = 0.0;
  double pwm_hz = 0.0;  ///< of the backlight, which is on bright and dark for half a period each; 0: steady
  double pwm_depth = 0.0;  ///< the halves are brighter and darker than the mean by this share

  /// How much brighter each channel is at the end of a capture than at its start, −0.05: 5 % darker.
  std::array<double, 3> drift{};
  /// Share of the capture in which 1 − 1/e of the change happens, as a lamp warms up; 0: evenly.
  double drift_settling = 0.0;

  /// Brightness of a channel, relative to the start, when the share `done` (0 to 1) of the capture is over.
  double gain(int channel, double done) const;

  /// Mean brightness of the pulsing backlight over [start, end], 1 in the long run. A bright half begins at
  /// 0.
  double backlight(TimePoint start, TimePoint end) const;

  /// Throws InputError naming the property and its range.
  void check() const;

  /// Radiance [256] that each 8-bit drive level of a channel emits:
  /// white_radiance · (black_level + (1 − black_level) · (level / 255)^gamma).
  std::array<std::vector<double>, 3> tone_curve() const;

  /// The radiance that the monitor emits when it is driven with `image`, falloff and dimming included.
  LightMap emitted(const DriveImage& image) const;
};

}  // namespace refield
