// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/free_view.h"

namespace refield {

FreeView::FreeView(const ReflectanceField& field)
    : FreeView(standard_camera(field), [&field](const PinholeCamera& camera, int samples) {
        return std::make_unique<const MeshView>(field, camera, samples);
      }) {}

FreeView::FreeView(const PinholeCamera& start, Look look) : look_(std::move(look)), orbit_(start) {
  update();
}

OrbitCamera& FreeView::move() {
  is_moved_ = true;
  return orbit_;
}

bool FreeView::update(Clock::time_point now) {
  const bool rests = is_settled_ || (!is_moved_ && is_rough_ && now - moved_at_ >= rest);
  if (!rests && !is_moved_) return false;
  view_ = look_(camera(), rests ? 4 : 1);
  if (is_moved_) moved_at_ = now;
  is_moved_ = is_settled_ = false;
  is_rough_ = !rests;
  return true;
}

}  // namespace refield
