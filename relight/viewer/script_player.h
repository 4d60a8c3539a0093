// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <deque>
#include <filesystem>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "relight/viewer/app.h"
#include "relight/viewer/script.h"

namespace refield {

/// Plays a script, a step a frame: mouse and keys as events that a user could have made, the rest by calls.
class ScriptPlayer {
 public:
  explicit ScriptPlayer(const std::string& path) : source_(path) {}

  /// Called before each frame. False when nothing is left to do for now. Throws InputError, which names the
  /// line, for what cannot be done.
  bool step(App& app, InputQueue& input);

  /// Called after each frame, for the statistics.
  void note_frame(const FrameTime& frame) { frames_.push_back(frame); }
  /// Where the frame about to be drawn is to be saved; empty: nowhere. Asked once a frame.
  std::filesystem::path take_screenshot() { return std::exchange(screenshot_, {}); }

 private:
  using Step = std::function<void(App&, InputQueue&)>;
  void plan(const ScriptCommand& command);
  void plan_click(const ScriptCommand& command, MouseButton button);
  void plan_drag(const ScriptCommand& command);
  void plan_setting(const ScriptCommand& command);
  void plan_camera(const ScriptCommand& command);
  void plan_output(const ScriptCommand& command);
  /// Frames in which panels settle.
  void plan_waiting(int frames);

  ScriptSource source_;
  std::deque<Step> steps_;
  std::vector<FrameTime> frames_;
  std::filesystem::path screenshot_;
};

}  // namespace refield
