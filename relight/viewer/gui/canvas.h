// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/image/tone_map.h"

namespace refield {

/// A rectangle of the window, in its pixels.
struct Area {
  double x = 0.0;
  double y = 0.0;
  double width = 0.0;
  double height = 0.0;
  bool holds(double px, double py) const { return px >= x && py >= y && px < x + width && py < y + height; }
};

struct Point {
  double x = 0.0;
  double y = 0.0;
};

/// Where the time of one frame went.
struct FrameTime {
  double total_ms = 0.0;  ///< from one frame's start to the next one's, waiting for the user left out
  double relight_ms = 0.0;
  double tone_ms = 0.0;
  double draw_ms = 0.0;   ///< textures, panels, OpenGL until the frame is shown
  double view_ms = 0.0;   ///< of fields over a mesh: finding what the camera sees, and its picture
  double light_ms = 0.0;  ///< making the light map: turning or projecting a map, painting light sources
  double wait_ms = 0.0;   ///< of the frame: relighting, or waiting for it where it is done in the background
};

/// What refreshing a frame did: whether the picture is another, and what it took.
struct Refreshed {
  bool picture = false;
  FrameTime time;  ///< all but total_ms and draw_ms
};

/// How an image lies in an area of the window: as large as fits, or zoomed and moved by hand.
class Canvas {
 public:
  /// Called each frame; an image of another size is fitted anew.
  void lay_out(const Area& area, int image_width, int image_height);
  void fit() { is_fitted_ = true; }
  /// One pixel of the image on one (or `scale`) of the window, the middle of the area kept.
  void zoom_to(double scale);
  /// By a factor about a point of the window, between a tenth of the fitted size and 64 window pixels a
  /// pixel.
  void zoom_about(const Point& window, double factor);
  /// By window pixels. Until the next fit().
  void pan(double dx, double dy);

  const Area& area() const { return area_; }
  /// Window pixels a pixel of the image.
  double scale() const { return scale_; }
  Point origin() const { return origin_; }
  Point window_from_image(const Point& image) const {
    return {origin_.x + image.x * scale_, origin_.y + image.y * scale_};
  }
  Point image_from_window(const Point& window) const {
    return {(window.x - origin_.x) / scale_, (window.y - origin_.y) / scale_};
  }

 private:
  double fitted_scale() const;
  void set_scale(double scale, const Point& about);

  Area area_;
  int width_ = 1, height_ = 1;
  double scale_ = 1.0;
  Point origin_;
  bool is_fitted_ = true;
};

/// The table of the mapping asked for last: making one takes as long as mapping half a million values.
class ToneTableCache {
 public:
  const LevelTable& table(const ToneMapping& mapping) {
    if (mapping != mapping_) table_ = LevelTable(mapping_ = mapping);
    return table_;
  }

 private:
  ToneMapping mapping_;
  LevelTable table_{mapping_};
};

}  // namespace refield
