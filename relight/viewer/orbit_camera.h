// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/camera.h"

namespace refield {

/// A camera that a user moves around what it looks at. +Y stays up.
class OrbitCamera {
 public:
  explicit OrbitCamera(const PinholeCamera& start);

  const PinholeCamera& camera() const { return camera_; }
  /// Of the picture, in pixels; the field of view follows the height.
  void set_size(int width, int height);

  /// Around the target: the camera goes so many degrees to its own right and up, as far as 89° above and
  /// below the horizon.
  void orbit(double right_degrees, double up_degrees);
  /// Nearer to the target by a factor, or further away below 1; between a thousandth and a thousandfold of
  /// the first distance.
  void approach(double factor);
  /// What is at the target moves by so many pixels to the right and down.
  void pan(double right_px, double down_px);
  /// Back to the start, in the present size.
  void reset();

 private:
  double distance() const { return (camera_.position - camera_.target).cast<double>().norm(); }

  PinholeCamera start_, camera_;
};

}  // namespace refield
