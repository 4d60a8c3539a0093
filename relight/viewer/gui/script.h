// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "relight/viewer/gui/input.h"
#include "relight/viewer/gui/window_state.h"

namespace refield {

/// One line of a script that drives the viewer; docs/guide/viewer.md describes the language.
struct ScriptCommand {
  std::string verb;
  bool on_light = false;  ///< positions are texels of the light map, else pixels of the image
  std::vector<double> numbers;
  std::string text;
  int line = 0;
};

/// Nothing for a blank line or a comment (#). Throws InputError, which names the line, for what is no
/// command.
std::optional<ScriptCommand> parse_script_line(const std::string& text, int line);

/// Gives a script's commands, of a file at once, of standard input as lines come in.
class ScriptSource {
 public:
  /// `path` "-" is standard input. Throws DeviceError for a file that cannot be read and InputError for a
  /// line that is no command, before anything is done.
  explicit ScriptSource(const std::string& path);

  /// The next command; nothing where there is none, or none yet.
  std::optional<ScriptCommand> next();

 private:
  void read_standard_input();
  void take_lines();

  bool is_standard_input_ = false;
  std::string unread_;
  int lines_ = 0;
  std::deque<ScriptCommand> commands_;
};

/// The event of pressing a shortcut of that name. Throws InputError for a name that none has.
KeyChanged key_named(const std::vector<ShortcutKey>& shortcuts, const std::string& name);

/// What a script needs of what the window shows.
struct ScriptStage {
  /// A position in the image or in the light map, in the window. Throws InputError where there is no light
  /// map.
  std::function<Point(bool on_light, double x, double y)> window_point;
  /// The event of pressing a key. Throws InputError for a name that no shortcut has.
  std::function<KeyChanged(const std::string&)> key;
  /// Does what is neither mouse nor key. Throws InputError for what is not to be had there.
  std::function<void(const ScriptCommand&)> perform;
  /// Whether a file is still being read: the script then waits. And whether the picture shows all that was
  /// done: commands that print or save wait for it.
  std::function<bool()> is_opening = [] { return false; };
  std::function<bool()> is_current = [] { return true; };
};

/// Plays a script, a step a frame: mouse and keys as events that a user could have made, the rest by calls.
class ScriptPlayer {
 public:
  /// All but `path` must outlive it.
  ScriptPlayer(const std::string& path, WindowState& window, const ScriptStage& stage, InputQueue& input)
      : source_(path), window_(window), stage_(stage), input_(input) {}

  /// Called before each frame. False when nothing is left to do for now. Throws InputError, which names the
  /// line, for what cannot be done.
  bool step();

  /// Called after each frame, for the statistics.
  void note_frame(const FrameTime& frame) { frames_.push_back(frame); }
  /// Where the frame about to be drawn is to be saved; empty: nowhere. Asked once a frame.
  std::filesystem::path take_screenshot() { return std::exchange(screenshot_, {}); }

 private:
  struct Step {
    std::function<void()> run;
    bool waits = false;  ///< for the picture
  };
  void plan(const ScriptCommand& command);
  /// `run` as the next frame's step, its errors with the command's line.
  void add(const ScriptCommand& command, std::function<void()> run, bool waits = false);
  void add_move(const ScriptCommand& command, double x, double y);
  void add_button(const ScriptCommand& command, MouseButton button, bool is_down);
  /// Frames in which panels settle.
  void add_waiting(int frames);
  void plan_click(const ScriptCommand& command);
  void plan_drag(const ScriptCommand& command);
  void plan_press(const ScriptCommand& command);
  /// What takes events of one frame alone.
  void push_events(const ScriptCommand& command);
  void put_out(const ScriptCommand& command);

  ScriptSource source_;
  WindowState& window_;
  const ScriptStage& stage_;
  InputQueue& input_;
  std::deque<Step> steps_;
  std::vector<FrameTime> frames_;
  std::filesystem::path screenshot_;
};

}  // namespace refield
