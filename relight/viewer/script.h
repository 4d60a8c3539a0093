// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <deque>
#include <optional>
#include <string>
#include <vector>

namespace refield {

/// One line of a script that drives the viewer; docs/guide/viewer.md describes the language.
struct ScriptCommand {
  enum class Verb {
    load,    ///< text: file
    move,    ///< target, numbers: x y
    pick,    ///< numbers: x y
    drag,    ///< target, numbers: x y x2 y2 frames
    probe,   ///< numbers: x y
    scroll,  ///< target, numbers: x y steps
    release,
    press,     ///< text: a control's label
    key,       ///< text: its name
    type,      ///< text: ASCII, into the text field that has the focus
    rotate,    ///< numbers: degrees
    select,    ///< text: a thing's name
    place,     ///< numbers: x y z
    gain,      ///< numbers: stops
    time,      ///< numbers: seconds
    bounces,   ///< numbers: how many
    orbit,     ///< numbers: degrees to the right, up
    approach,  ///< numbers: factor
    pan,       ///< numbers: pixels to the right, down
    exposure,  ///< numbers: stops
    curve,     ///< text
    show,      ///< text
    wait,      ///< numbers: frames
    fps,
    where,
    screenshot,  ///< text: file
    save,        ///< text: file
    save_light,  ///< text: file
    quit
  };
  enum class Target { picture, light };

  Verb verb = Verb::wait;
  Target target = Target::picture;
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

}  // namespace refield
