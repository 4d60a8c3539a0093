// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "acquire/calibrate/calibration.h"
#include "simulate/rig/virtual_rig.h"

namespace refield::test {

/// What the camera of a known rig looks at.
enum class View {
  scene,  ///< things of many brightnesses, each lit by the whole display, by one half of it more than by the
          ///< other
  card,   ///< evenly lit and plain
  screen  ///< the display itself, one texel a pixel
};

inline constexpr int known_width = 64;
inline constexpr int known_height = 48;

/// A small virtual rig for calibrating: its truth is in the models.
VirtualRig known_rig(View view, const MonitorModel& monitor, const SensorModel& sensor, float ambient = 0.01f,
                     std::uint64_t seed = 1);

/// What a faultless calibration of this sensor gives, gain 1.
CameraCalibration true_calibration(const SensorModel& sensor);

}  // namespace refield::test
