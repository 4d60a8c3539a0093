// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/image/image_io.h"
#include "relight/viewer/gui/input.h"

namespace refield {

struct WindowColour {
  float red, green, blue;
};

/// Neutral greys around pictures, so that they alone have colour; amber marks what is selected.
void apply_theme(float scale);
WindowColour background_colour();

/// A window with OpenGL 3.3 and Dear ImGui: collects input, draws frames. One at a time.
class GlWindow {
 public:
  /// `takes_input`: from mouse and keyboard; without, the window does what a script alone says.
  /// Throws DeviceError where there is no display or OpenGL is too old.
  GlWindow(int width, int height, bool takes_input);
  ~GlWindow();
  GlWindow(const GlWindow&) = delete;
  GlWindow& operator=(const GlWindow&) = delete;

  bool is_closed() const;
  void set_title(const std::string& title);

  /// Adds what happened since the last call to `queue`; waits for it up to `patience_s`.
  void collect(InputQueue& queue, double patience_s);

  /// Hands a frame's mouse and text events to Dear ImGui and begins the frame.
  void begin_frame(std::span<const InputEvent> events);
  /// Draws what was asked of Dear ImGui since begin_frame(), and shows it. `shot`, where given, takes what
  /// the window shows.
  void end_frame(ScreenImage* shot);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// A picture on the graphics card. Needs the window.
class Texture {
 public:
  Texture() = default;
  ~Texture();
  Texture(const Texture&) = delete;
  Texture& operator=(const Texture&) = delete;

  /// `rgba` [width × height × 4].
  void update(int width, int height, std::span<const std::uint8_t> rgba);
  /// Whether pixels blend into each other when enlarged.
  void set_smooth(bool is_smooth);
  /// As Dear ImGui takes it.
  void* handle() const;

 private:
  unsigned name_ = 0;
  int width_ = 0, height_ = 0;
  bool is_smooth_ = true;
};

}  // namespace refield
