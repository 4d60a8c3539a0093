// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <chrono>
#include <functional>
#include <memory>

#include "relight/mesh_view.h"
#include "relight/viewer/orbit_camera.h"

namespace refield {

/// What a user's camera sees of meshes: with one line of sight a pixel while it moves, with four
/// once it rests.
class FreeView {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr auto rest = std::chrono::milliseconds(150);  ///< so long without a move

  /// Finds what a camera sees by so many lines of sight a pixel.
  using Look = std::function<std::unique_ptr<const MeshView>(const PinholeCamera& camera, int samples)>;

  /// `field` must outlive this.
  explicit FreeView(const ReflectanceField& field);
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

  const MeshView& seen() const { return *view_; }

 private:
  Look look_;
  OrbitCamera orbit_;
  std::unique_ptr<const MeshView> view_;
  bool is_moved_ = true, is_rough_ = true, is_settled_ = false;
  Clock::time_point moved_at_{};
};

}  // namespace refield
