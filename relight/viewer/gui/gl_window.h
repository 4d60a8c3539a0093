// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>

#include "core/base/run_context.h"
#include "core/image/image_io.h"
#include "relight/viewer/gui/input.h"
#include "relight/viewer/gui/window_state.h"

namespace refield {

/// A window with OpenGL 3.3 and Dear ImGui: collects input, draws frames. One at a time.
class GlWindow {
 public:
  /// Throws DeviceError where there is no display or OpenGL is too old.
  GlWindow(int width, int height);
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

/// What a window shows, as its loop takes it.
struct WindowContent {
  WindowState& state;
  std::function<std::string()> title;
  /// Whether another frame is due though nothing happened.
  std::function<bool()> wants_frame;
  /// Whether things move by themselves, and their motion by the seconds since the last frame.
  std::function<bool()> is_moving;
  std::function<void(double seconds)> advance;
  /// Dropped files, and keys while no text is typed; mouse and text go to the panels.
  std::function<void(const InputEvent&)> handle;
  /// Panels and what they show; all but total_ms and draw_ms of the time that it took.
  std::function<FrameTime()> draw;
};

/// Shows a message, and since when it is there, until `is_done`, called with the time that it may wait,
/// returns true. False: the window was closed before. Throws Interrupted.
bool show_message_until(GlWindow& window, const std::string& message,
                        const std::function<bool(std::chrono::milliseconds patience)>& is_done,
                        const RunContext& run);

/// Shows `content` until the window is closed, sleeping while nothing happens. Throws Interrupted.
void run_window(GlWindow& window, const WindowContent& content);

}  // namespace refield
