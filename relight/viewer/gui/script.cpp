// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/gui/script.h"

#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <ranges>
#include <string_view>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/number_text.h"

namespace refield {

namespace {

using Verb = ScriptCommand::Verb;
using Target = ScriptCommand::Target;

/// What follows a verb.
struct Grammar {
  std::string_view name;
  Verb verb;
  bool has_target;
  int least_numbers, max_numbers;
  bool has_text;
  std::string_view usage;
};

constexpr std::array<Grammar, 17> grammars = {{
    {"load", Verb::load, false, 0, 0, true, "load FILE"},
    {"pick", Verb::pick, false, 2, 2, false, "pick X Y"},
    {"drag", Verb::drag, true, 4, 5, false, "drag image|light X Y X2 Y2 [FRAMES]"},
    {"probe", Verb::probe, false, 2, 2, false, "probe X Y"},
    {"scroll", Verb::scroll, true, 3, 3, false, "scroll image|light X Y STEPS"},
    {"release", Verb::release, false, 0, 0, false, "release"},
    {"press", Verb::press, false, 0, 0, true, "press LABEL"},
    {"key", Verb::key, false, 0, 0, true, "key NAME"},
    {"type", Verb::type, false, 0, 0, true, "type TEXT"},
    {"pan", Verb::pan, false, 2, 2, false, "pan PIXELS_RIGHT PIXELS_DOWN"},
    {"wait", Verb::wait, false, 1, 1, false, "wait FRAMES"},
    {"fps", Verb::fps, false, 0, 0, false, "fps"},
    {"where", Verb::where, false, 0, 0, false, "where"},
    {"screenshot", Verb::screenshot, false, 0, 0, true, "screenshot FILE.png"},
    {"save", Verb::save, false, 0, 0, true, "save FILE.exr|FILE.png"},
    {"save-light", Verb::save_light, false, 0, 0, true, "save-light FILE.exr|FILE.png"},
    {"quit", Verb::quit, false, 0, 0, false, "quit"},
}};

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

Target target_named(std::string_view word, const Grammar& grammar, const std::string& place) {
  if (word == "image") return Target::picture;
  if (word == "light") return Target::light;
  throw InputError(place + "'" + std::string(word) + "' is neither image nor light; write " +
                   std::string(grammar.usage));
}

const Grammar& grammar_of(std::string_view name, const std::string& place) {
  const auto found = std::ranges::find(grammars, name, &Grammar::name);
  if (found != grammars.end()) return *found;
  throw InputError(place + "there is no command '" + std::string(name) + "'; there are " +
                   listed(grammars, grammars.size(), &Grammar::name));
}

constexpr int settling_frames = 2;
constexpr int usual_drag_frames = 30;

/// The middle of a pixel or texel, in the window.
MouseMoved over(const ScriptStage& stage, Target target, double x, double y) {
  const Point p = stage.window_point(target, x + 0.5, y + 0.5);
  return {p.x, p.y};
}

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
  ScriptCommand command{grammar.verb, ScriptCommand::Target::picture, {}, "", line};
  if (grammar.has_target) command.target = target_named(take_word(rest), grammar, place);
  if (grammar.has_text) {
    command.text = rest;
    rest = {};
  }
  while (!rest.empty()) command.numbers.push_back(number(take_word(rest), place));
  const auto count = static_cast<int>(command.numbers.size());
  if (count < grammar.least_numbers || count > grammar.max_numbers ||
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

void ScriptPlayer::add(const ScriptCommand& command, std::function<void(const Driven&)> run, bool waits) {
  const auto told = [line = command.line, run = std::move(run)](const Driven& driven) {
    try {
      run(driven);
    } catch (const InputError& error) {
      throw InputError("script, line " + std::to_string(line) + ": " + error.what());
    }
  };
  steps_.push_back({told, waits});
}

void ScriptPlayer::plan_waiting(int frames) {
  for (int i = 0; i < frames; ++i) steps_.push_back({[](const Driven&) {}});
}

void ScriptPlayer::plan_click(const ScriptCommand& command, MouseButton button) {
  const bool holds = command.verb == Verb::probe;
  const Target target = holds ? Target::light : Target::picture;
  add(command, [=, at = command.numbers](const Driven& driven) {
    driven.input.push(over(driven.stage, target, at[0], at[1]));
  });
  plan_waiting(1);
  add(command, [=](const Driven& driven) { driven.input.push(MouseButtonChanged{button, true}); });
  plan_waiting(1);
  if (!holds)
    add(command, [=](const Driven& driven) { driven.input.push(MouseButtonChanged{button, false}); });
  plan_waiting(settling_frames);
}

void ScriptPlayer::plan_drag(const ScriptCommand& command) {
  const auto& at = command.numbers;
  const int frames = at.size() > 4 ? static_cast<int>(at[4]) : usual_drag_frames;
  if (frames < 1)
    throw InputError("script, line " + std::to_string(command.line) + ": a drag takes 1 frame or more");
  const auto go_to = [&](double x, double y) {
    add(command, [=, target = command.target](const Driven& driven) {
      driven.input.push(over(driven.stage, target, x, y));
    });
  };
  const auto hold = [&](bool is_down) {
    add(command, [=](const Driven& driven) {
      driven.input.push(MouseButtonChanged{MouseButton::left, is_down});
    });
  };
  go_to(at[0], at[1]);
  plan_waiting(1);
  hold(true);
  for (int i = 1; i <= frames; ++i) {
    const double t = static_cast<double>(i) / frames;
    go_to(at[0] + t * (at[2] - at[0]), at[1] + t * (at[3] - at[1]));
  }
  hold(false);
  plan_waiting(settling_frames);
}

void ScriptPlayer::plan_output(const ScriptCommand& command) {
  plan_waiting(1);
  const auto run = [this, command](const Driven& driven) {
    if (command.verb == Verb::fps) {
      std::printf("%s\n", text_of(frame_statistics(frames_)).c_str());
      std::fflush(stdout);
      frames_.clear();
    } else if (command.verb == Verb::screenshot) {
      screenshot_ = command.text;
    } else if (command.verb == Verb::quit) {
      driven.window.wants_to_close = true;
    } else {
      driven.stage.perform(command);
    }
  };
  add(command, run, command.verb != Verb::quit);
}

void ScriptPlayer::plan_press(const ScriptCommand& command) {
  add(command, [=](const Driven& driven) {
    const Point p = control_named(driven.window, command.text);
    driven.input.push(MouseMoved{p.x, p.y});
  });
  plan_waiting(1);
  add(command, [](const Driven& driven) {
    driven.input.push(MouseButtonChanged{MouseButton::left, true});
    driven.input.push(MouseButtonChanged{MouseButton::left, false});
  });
  plan_waiting(settling_frames + 1);
}

void ScriptPlayer::plan_input(const ScriptCommand& command) {
  add(command, [=](const Driven& driven) {
    InputQueue& input = driven.input;
    if (command.verb == Verb::load) input.push(FilesDropped{{command.text}});
    if (command.verb == Verb::scroll) {
      input.push(over(driven.stage, command.target, command.numbers[0], command.numbers[1]));
      input.push(MouseScrolled{0.0, command.numbers[2]});
    }
    if (command.verb == Verb::key) {
      KeyChanged key = driven.stage.key(command.text);
      input.push(key);
      key.is_down = false;
      input.push(key);
    }
    if (command.verb == Verb::type)
      for (const char c : command.text) input.push(CharacterTyped{static_cast<unsigned char>(c)});
    if (command.verb == Verb::release)
      for (const auto button : {MouseButton::left, MouseButton::right, MouseButton::middle})
        input.push(MouseButtonChanged{button, false});
  });
  plan_waiting(command.verb == Verb::release ? settling_frames + 2 : settling_frames);
}

void ScriptPlayer::plan(const ScriptCommand& command) {
  switch (command.verb) {
    case Verb::load:
    case Verb::scroll:
    case Verb::release:
    case Verb::key:
    case Verb::type:
      return plan_input(command);
    case Verb::pick:
      return plan_click(command, MouseButton::left);
    case Verb::probe:
      return plan_click(command, MouseButton::right);
    case Verb::drag:
      return plan_drag(command);
    case Verb::press:
      return plan_press(command);
    case Verb::wait:
      return plan_waiting(static_cast<int>(command.numbers[0]));
    case Verb::fps:
    case Verb::where:
    case Verb::screenshot:
    case Verb::save:
    case Verb::save_light:
    case Verb::quit:
      return plan_output(command);
    case Verb::pan:
      add(command, [=](const Driven& driven) { driven.stage.perform(command); });
      return plan_waiting(settling_frames);
  }
}

bool ScriptPlayer::step(WindowState& window, const ScriptStage& stage, InputQueue& input) {
  if (stage.is_opening()) return true;
  while (steps_.empty()) {
    const auto command = source_.next();
    if (!command) return false;
    plan(*command);
  }
  if (steps_.front().waits && !stage.is_current()) return true;
  const Step next = std::move(steps_.front());
  steps_.pop_front();
  next.run({window, stage, input});
  return true;
}

}  // namespace refield
