// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/gui/script.h"

#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <ranges>
#include <set>
#include <string_view>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/number_text.h"

namespace refield {

namespace {

/// A command as it is written; its name is the first word.
struct Grammar {
  std::string_view usage;
  int min_numbers, max_numbers;
  bool has_target = false, has_text = false;

  std::string_view name() const { return usage.substr(0, usage.find(' ')); }
};

constexpr std::array grammars = {
    Grammar{"load FILE", 0, 0, false, true},
    Grammar{"pick X Y", 2, 2},
    Grammar{"drag image|light X Y X2 Y2 [FRAMES]", 4, 5, true},
    Grammar{"probe X Y", 2, 2},
    Grammar{"scroll image|light X Y STEPS", 3, 3, true},
    Grammar{"release", 0, 0},
    Grammar{"press LABEL", 0, 0, false, true},
    Grammar{"key NAME", 0, 0, false, true},
    Grammar{"type TEXT", 0, 0, false, true},
    Grammar{"pan PIXELS_RIGHT PIXELS_DOWN", 2, 2},
    Grammar{"wait FRAMES", 1, 1},
    Grammar{"fps", 0, 0},
    Grammar{"where", 0, 0},
    Grammar{"screenshot FILE.png", 0, 0, false, true},
    Grammar{"save FILE.exr|FILE.png", 0, 0, false, true},
    Grammar{"save-light FILE.exr|FILE.png", 0, 0, false, true},
    Grammar{"quit", 0, 0},
};

constexpr std::string_view blanks = " \t\r";

std::string_view trimmed(std::string_view text) {
  const auto first = text.find_first_not_of(blanks);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(blanks) - first + 1);
}

/// Takes the first word off `rest`.
std::string_view take_word(std::string_view& rest) {
  rest = trimmed(rest);
  const auto word = rest.substr(0, rest.find_first_of(blanks));
  rest = trimmed(rest.substr(word.size()));
  return word;
}

double number(std::string_view word, const std::string& place) {
  const auto value = number_from_text<double>(word);
  if (!value || !std::isfinite(*value)) throw InputError(place + "'" + std::string(word) + "' is no number");
  return *value;
}

const Grammar& grammar_of(std::string_view name, const std::string& place) {
  const auto found = std::ranges::find(grammars, name, &Grammar::name);
  if (found != grammars.end()) return *found;
  throw InputError(place + "there is no command '" + std::string(name) + "'; there are " +
                   listed(grammars, grammars.size(), &Grammar::name));
}

constexpr int settling_frames = 2;
constexpr int usual_drag_frames = 30;

Point control_named(const WindowState& window, const std::string& name) {
  const auto found = window.controls.find(name);
  if (found != window.controls.end() && found->second.is_visible) return found->second.middle;
  if (found != window.controls.end())
    throw InputError("the control '" + name + "' is scrolled out of view; take a larger window (--size)");
  throw InputError("there is no control '" + name + "' now; there are " +
                   listed(std::views::keys(window.controls)));
}

}  // namespace

std::optional<ScriptCommand> parse_script_line(const std::string& text, int line) {
  std::string_view rest = trimmed(text);
  if (rest.empty() || rest.front() == '#') return std::nullopt;
  const std::string place = "script, line " + std::to_string(line) + ": ";
  const Grammar& grammar = grammar_of(take_word(rest), place);
  ScriptCommand command{std::string(grammar.name()), grammar.name() == "probe", {}, "", line};
  if (grammar.has_target) {
    const std::string target(take_word(rest));
    if (target != "image" && target != "light")
      throw InputError(place + "'" + target + "' is neither image nor light; write " +
                       std::string(grammar.usage));
    command.on_light = target == "light";
  }
  if (grammar.has_text) {
    command.text = rest;
    rest = {};
  }
  while (!rest.empty()) command.numbers.push_back(number(take_word(rest), place));
  const auto count = static_cast<int>(command.numbers.size());
  if (count < grammar.min_numbers || count > grammar.max_numbers ||
      (grammar.has_text && command.text.empty()))
    throw InputError(place + "write " + std::string(grammar.usage));
  return command;
}

ScriptSource::ScriptSource(const std::string& path) : is_standard_input_(path == "-") {
  if (is_standard_input_) return;
  unread_ = read_text(path) + "\n";
  take_lines();
}

void ScriptSource::take_lines() {
  for (auto end = unread_.find('\n'); end != std::string::npos; end = unread_.find('\n')) {
    if (auto command = parse_script_line(unread_.substr(0, end), ++lines_))
      commands_.push_back(std::move(*command));
    unread_.erase(0, end + 1);
  }
}

void ScriptSource::read_standard_input() {
  pollfd ready{STDIN_FILENO, POLLIN, 0};
  while (::poll(&ready, 1, 0) == 1) {
    char buffer[4096];
    const ssize_t count = ::read(STDIN_FILENO, buffer, sizeof buffer);
    if (count <= 0) {
      is_standard_input_ = false;  // closed
      unread_ += '\n';
      break;
    }
    unread_.append(buffer, static_cast<std::size_t>(count));
  }
  take_lines();
}

std::optional<ScriptCommand> ScriptSource::next() {
  if (commands_.empty() && is_standard_input_) read_standard_input();
  if (commands_.empty()) return std::nullopt;
  ScriptCommand command = std::move(commands_.front());
  commands_.pop_front();
  return command;
}

KeyChanged key_named(const std::vector<ShortcutKey>& shortcuts, const std::string& name) {
  const auto found = std::ranges::find(shortcuts, name, &ShortcutKey::name);
  if (found != shortcuts.end()) return {found->key, true, found->with_shift, false};
  std::string known;
  for (const ShortcutKey& shortcut : shortcuts) known.append(known.empty() ? "" : " ").append(shortcut.name);
  throw InputError("no shortcut has the key '" + name + "'; there are " + known);
}

void ScriptPlayer::add(const ScriptCommand& command, std::function<void()> run, bool waits) {
  const auto told = [line = command.line, run = std::move(run)] {
    try {
      run();
    } catch (const InputError& error) {
      throw InputError("script, line " + std::to_string(line) + ": " + error.what());
    }
  };
  steps_.push_back({told, waits});
}

/// To the middle of a pixel or texel.
void ScriptPlayer::add_move(const ScriptCommand& command, double x, double y) {
  add(command, [=, this, on_light = command.on_light] {
    const Point p = stage_.window_point(on_light, x + 0.5, y + 0.5);
    input_.push(MouseMoved{p.x, p.y});
  });
}

void ScriptPlayer::add_button(const ScriptCommand& command, MouseButton button, bool is_down) {
  add(command, [=, this] { input_.push(MouseButtonChanged{button, is_down}); });
}

void ScriptPlayer::add_waiting(int frames) {
  for (int i = 0; i < frames; ++i) steps_.push_back({[] {}});
}

void ScriptPlayer::plan_click(const ScriptCommand& command) {
  const bool holds = command.verb == "probe";
  const MouseButton button = holds ? MouseButton::right : MouseButton::left;
  add_move(command, command.numbers[0], command.numbers[1]);
  add_waiting(1);
  add_button(command, button, true);
  add_waiting(1);
  if (!holds) add_button(command, button, false);
  add_waiting(settling_frames);
}

void ScriptPlayer::plan_drag(const ScriptCommand& command) {
  const auto& at = command.numbers;
  const int frames = at.size() > 4 ? static_cast<int>(at[4]) : usual_drag_frames;
  if (frames < 1)
    throw InputError("script, line " + std::to_string(command.line) + ": a drag takes 1 frame or more");
  add_move(command, at[0], at[1]);
  add_waiting(1);
  add_button(command, MouseButton::left, true);
  for (int i = 1; i <= frames; ++i) {
    const double t = static_cast<double>(i) / frames;
    add_move(command, at[0] + t * (at[2] - at[0]), at[1] + t * (at[3] - at[1]));
  }
  add_button(command, MouseButton::left, false);
  add_waiting(settling_frames);
}

void ScriptPlayer::plan_press(const ScriptCommand& command) {
  add(command, [=, this] {
    const Point p = control_named(window_, command.text);
    input_.push(MouseMoved{p.x, p.y});
  });
  add_waiting(1);
  add(command, [this] {
    input_.push(MouseButtonChanged{MouseButton::left, true});
    input_.push(MouseButtonChanged{MouseButton::left, false});
  });
  add_waiting(settling_frames + 1);
}

void ScriptPlayer::put_out(const ScriptCommand& command) {
  if (command.verb == "fps") {
    std::printf("%s\n", text_of(frame_statistics(frames_)).c_str());
    std::fflush(stdout);
    frames_.clear();
  } else if (command.verb == "screenshot") {
    screenshot_ = command.text;
  } else if (command.verb == "quit") {
    window_.wants_to_close = true;
  } else {
    stage_.perform(command);
  }
}

void ScriptPlayer::push_events(const ScriptCommand& command) {
  if (command.verb == "load") input_.push(FilesDropped{{command.text}});
  if (command.verb == "scroll") {
    const Point p = stage_.window_point(command.on_light, command.numbers[0] + 0.5, command.numbers[1] + 0.5);
    input_.push(MouseMoved{p.x, p.y});
    input_.push(MouseScrolled{0.0, command.numbers[2]});
  }
  if (command.verb == "key") {
    KeyChanged key = stage_.key(command.text);
    input_.push(key);
    key.is_down = false;
    input_.push(key);
  }
  if (command.verb == "type")
    for (const char c : command.text) input_.push(CharacterTyped{static_cast<unsigned char>(c)});
  if (command.verb == "release")
    for (const auto button : {MouseButton::left, MouseButton::right, MouseButton::middle})
      input_.push(MouseButtonChanged{button, false});
  if (command.verb == "pan") stage_.perform(command);
}

void ScriptPlayer::plan(const ScriptCommand& command) {
  static const std::set<std::string_view> outputs = {"fps",  "where",      "screenshot",
                                                     "save", "save-light", "quit"};
  if (command.verb == "pick" || command.verb == "probe") return plan_click(command);
  if (command.verb == "drag") return plan_drag(command);
  if (command.verb == "press") return plan_press(command);
  if (command.verb == "wait") return add_waiting(static_cast<int>(command.numbers[0]));
  if (outputs.contains(command.verb)) {
    add_waiting(1);
    return add(
        command, [=, this] { put_out(command); }, command.verb != "quit");
  }
  add(command, [=, this] { push_events(command); });
  add_waiting(command.verb == "release" ? settling_frames + 2 : settling_frames);
}

bool ScriptPlayer::step() {
  if (stage_.is_opening()) return true;
  while (steps_.empty()) {
    const auto command = source_.next();
    if (!command) return false;
    plan(*command);
  }
  if (steps_.front().waits && !stage_.is_current()) return true;
  const Step next = std::move(steps_.front());
  steps_.pop_front();
  next.run();
  return true;
}

}  // namespace refield
