// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <chrono>
#include <functional>
#include <optional>
#include <string>

#include "core/base/run_context.h"
#include "relight/viewer/gui/gl_window.h"
#include "relight/viewer/gui/script.h"
#include "relight/viewer/gui/window_state.h"

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

/// Shows a message, and since when it is there, until `is_done`, called with the time that it may wait,
/// returns true. False: the window was closed before. Throws Interrupted.
bool show_message_until(GlWindow& window, const std::string& message,
                        const std::function<bool(std::chrono::milliseconds patience)>& is_done,
                        const RunContext& run);

/// Shows `content` until the window is closed, sleeping while nothing happens. `script`: a file of commands,
/// or "-". Throws InputError for a wrong line of it, and Interrupted.
void run_window(GlWindow& window, const std::optional<std::string>& script, const WindowContent& content);

}  // namespace refield
