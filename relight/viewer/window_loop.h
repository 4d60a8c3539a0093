// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>
#include <optional>
#include <string>

#include "relight/viewer/gl_window.h"
#include "relight/viewer/script_player.h"
#include "relight/viewer/window_state.h"

namespace refield {

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
  ScriptStage stage;
};

/// Shows `content` until the window is closed, sleeping while nothing happens. `script`: a file of commands,
/// or "-". Throws InputError for a wrong line of it, and Interrupted.
void run_window(GlWindow& window, const std::optional<std::string>& script, const WindowContent& content);

}  // namespace refield
