// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <chrono>

#include "core/field/mesh.h"
#include "relight/mesh/mesh_view.h"
#include "relight/viewer/gui/canvas.h"

namespace refield {

/// A camera that a user moves around what it looks at. +Y stays up.
class OrbitCamera {
 public:
  explicit OrbitCamera(const PinholeCamera& start);

  const PinholeCamera& camera() const { return camera_; }
  /// Of the picture, in pixels; the field of view follows the height.
  void set_size(int width, int height);

  /// Around the target: the camera goes that many degrees to its own right and up, as far as 89° above and
  /// below the horizon.
  void orbit(double right_degrees, double up_degrees);
  /// Nearer to the target by a factor, or further away below 1; between a thousandth and a thousandfold of
  /// the first distance.
  void approach(double factor);
  /// What is at the target moves by that many pixels to the right and down.
  void pan(double right_px, double down_px);
  /// Back to the start, in the present size.
  void reset();

 private:
  double distance() const { return (camera_.position - camera_.target).cast<double>().norm(); }

  PinholeCamera start_, camera_;
};

/// What a user's camera sees of meshes: with one line of sight a pixel while it moves, with four
/// once it rests.
class FreeView {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr auto rest = std::chrono::milliseconds(150);  ///< so long without a move

  /// Finds what a camera sees by that many lines of sight a pixel.
  using Look = std::function<std::unique_ptr<const MeshRenderer>(const PinholeCamera& camera, int samples)>;

  /// `field` must outlive this.
  explicit FreeView(const FieldOutline& field);
  /// Of things that move: whoever moves them calls move(), too.
  FreeView(const PinholeCamera& start, Look look);

  const PinholeCamera& camera() const { return orbit_.camera(); }
  /// For changes of it; what it sees is found at the next update().
  OrbitCamera& move();

  /// Whether move() was called since the last update().
  bool is_moved() const { return is_moved_; }
  /// Finds what is seen where that is outdated; whether the picture is another now.
  bool update(Clock::time_point now = Clock::now());
  /// The next update() takes the camera to be at rest.
  void settle() { is_settled_ = is_moved_ || is_rough_; }
  /// Whether update() has yet to be called once the camera rests.
  bool wants_rest() const { return is_rough_; }

  const MeshRenderer& seen() const { return *view_; }

 private:
  Look look_;
  OrbitCamera orbit_;
  std::unique_ptr<const MeshRenderer> view_;
  bool is_moved_ = true, is_rough_ = true, is_settled_ = false;
  Clock::time_point moved_at_{};
};

}  // namespace refield
