// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/gui/canvas.h"

#include <cmath>

namespace refield {

double Canvas::fitted_scale() const {
  return std::max(1e-3, std::min(area_.width / width_, area_.height / height_));
}

void Canvas::lay_out(const Area& area, int image_width, int image_height) {
  if (image_width != width_ || image_height != height_) is_fitted_ = true;
  // What was in the middle stays there when the window changes.
  origin_.x += area.x + 0.5 * area.width - area_.x - 0.5 * area_.width;
  origin_.y += area.y + 0.5 * area.height - area_.y - 0.5 * area_.height;
  area_ = area;
  width_ = image_width;
  height_ = image_height;
  if (is_fitted_) scale_ = fitted_scale();
  // Whole window pixels: at scale 1 each pixel of the image falls on one of the window.
  const double left = area.x + 0.5 * (area.width - width_ * scale_);
  const double top = area.y + 0.5 * (area.height - height_ * scale_);
  if (is_fitted_) origin_ = {left, top};
  origin_ = {std::round(origin_.x), std::round(origin_.y)};
}

void Canvas::set_scale(double scale, const Point& about) {
  const Point fixed = image_from_window(about);
  scale_ = std::clamp(scale, std::min(0.1 * fitted_scale(), 1.0), 64.0);
  is_fitted_ = false;
  origin_ = {about.x - fixed.x * scale_, about.y - fixed.y * scale_};
}

void Canvas::zoom_to(double scale) {
  set_scale(scale, {area_.x + 0.5 * area_.width, area_.y + 0.5 * area_.height});
}

void Canvas::zoom_about(const Point& window, double factor) {
  set_scale(scale_ * factor, window);
}

void Canvas::pan(double dx, double dy) {
  origin_.x += dx;
  origin_.y += dy;
  is_fitted_ = false;
}

}  // namespace refield
