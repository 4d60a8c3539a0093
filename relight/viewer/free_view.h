// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <chrono>
#include <memory>
#include <optional>

#include "relight/mesh_view.h"
#include "relight/viewer/orbit_camera.h"

namespace refield {

/// What a user's camera sees of a field over a mesh: with one line of sight a pixel while it moves, with four
/// once it rests.
class FreeView {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr auto rest = std::chrono::milliseconds(150);  ///< so long without a move

  /// `field` must outlive this.
  explicit FreeView(const ReflectanceField& field);

  const PinholeCamera& camera() const { return orbit_.camera(); }
  /// For changes of it; what it sees is found at the next update().
  OrbitCamera& move();

  /// Finds what is seen where that is outdated; whether the picture is another now.
  bool update(Clock::time_point now = Clock::now());
  /// The next update() takes the camera to be at rest.
  void settle() { is_settled_ = is_moved_ || is_rough_; }
  /// Whether update() has yet to be called once the camera rests.
  bool wants_rest() const { return is_rough_; }

  Image show(const Image& outputs) const { return view_->show(outputs); }
  std::optional<std::uint32_t> vertex_at(int x, int y) const { return view_->vertex_at(x, y); }

 private:
  const ReflectanceField* field_;
  OrbitCamera orbit_;
  std::unique_ptr<const MeshView> view_;
  bool is_moved_ = true, is_rough_ = true, is_settled_ = false;
  Clock::time_point moved_at_{};
};

}  // namespace refield
