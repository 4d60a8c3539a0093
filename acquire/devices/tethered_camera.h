// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <optional>
#include <string>

#include "acquire/camera.h"

namespace refield {

/// A window of a frame, pixels.
struct FrameWindow {
  int x = 0;
  int y = 0;
  int width = 0;
  int height = 0;
};

/// What every camera on a cable is asked for.
struct CameraOptions {
  std::string device;                 ///< names the camera; how, is said where it is looked for
  std::string format;                 ///< of the pixels; empty: the one that is best for measuring
  double rate = 0.0;                  ///< frames per second; 0: what the camera is set to
  std::optional<FrameWindow> window;  ///< part of the frame to keep; the whole without it
  /// Value of the gain control that stands for gain 1; other gains are multiples of it. 0: see the camera.
  double unit_gain = 0.0;
  Seconds replug_patience{30};  ///< how long an unplugged camera is waited for
};

/// What went wrong on the way and was mended; frames in it are lost, never wrong.
struct CameraTroubles {
  std::uint64_t damaged = 0;   ///< frames that the driver marked as damaged, or that were torn or incomplete
  std::uint64_t restarts = 0;  ///< streaming broke and was started anew
  std::uint64_t replugs = 0;   ///< the camera was gone and came back
};

/// A camera on a cable, which may be pulled.
class TetheredCamera : public Camera {
 public:
  virtual const CameraTroubles& troubles() const = 0;
};

}  // namespace refield
