// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/script.h"

#include <poll.h>
#include <unistd.h>

#include <array>
#include <charconv>
#include <cmath>
#include <string_view>

#include "core/errors.h"
#include "core/files.h"

namespace refield {

namespace {

using Verb = ScriptCommand::Verb;

/// What follows a verb.
struct Grammar {
  std::string_view name;
  Verb verb;
  bool has_target;
  int least_numbers, most_numbers;
  bool has_text;
  std::string_view usage;
};

constexpr std::array<Grammar, 29> grammars = {{
    {"load", Verb::load, false, 0, 0, true, "load FILE"},
    {"move", Verb::move, true, 2, 2, false, "move image|light X Y"},
    {"pick", Verb::pick, false, 2, 2, false, "pick X Y"},
    {"drag", Verb::drag, true, 4, 5, false, "drag image|light X Y X2 Y2 [FRAMES]"},
    {"probe", Verb::probe, false, 2, 2, false, "probe X Y"},
    {"scroll", Verb::scroll, true, 3, 3, false, "scroll image|light X Y STEPS"},
    {"release", Verb::release, false, 0, 0, false, "release"},
    {"press", Verb::press, false, 0, 0, true, "press LABEL"},
    {"key", Verb::key, false, 0, 0, true, "key NAME"},
    {"type", Verb::type, false, 0, 0, true, "type TEXT"},
    {"rotate", Verb::rotate, false, 1, 1, false, "rotate DEGREES"},
    {"select", Verb::select, false, 0, 0, true, "select NAME"},
    {"place", Verb::place, false, 3, 3, false, "place X Y Z"},
    {"gain", Verb::gain, false, 1, 1, false, "gain STOPS"},
    {"time", Verb::time, false, 1, 1, false, "time SECONDS"},
    {"bounces", Verb::bounces, false, 1, 1, false, "bounces NUMBER"},
    {"orbit", Verb::orbit, false, 2, 2, false, "orbit DEGREES_RIGHT DEGREES_UP"},
    {"approach", Verb::approach, false, 1, 1, false, "approach FACTOR"},
    {"pan", Verb::pan, false, 2, 2, false, "pan PIXELS_RIGHT PIXELS_DOWN"},
    {"exposure", Verb::exposure, false, 1, 1, false, "exposure STOPS"},
    {"curve", Verb::curve, false, 0, 0, true, "curve clip|reinhard|filmic"},
    {"show", Verb::show, false, 0, 0, true, "show picture|false-colour|error|noise|training-error"},
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
  double value = 0.0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error != std::errc() || end != word.data() + word.size() || !std::isfinite(value))
    throw InputError(place + "'" + std::string(word) + "' is no number");
  return value;
}

ScriptCommand::Target target(std::string_view word, const Grammar& grammar, const std::string& place) {
  if (word == "image") return ScriptCommand::Target::picture;
  if (word == "light") return ScriptCommand::Target::light;
  throw InputError(place + "'" + std::string(word) + "' is neither image nor light; write " +
                   std::string(grammar.usage));
}

const Grammar& grammar_of(std::string_view name, const std::string& place) {
  std::string known;
  for (const Grammar& grammar : grammars) {
    if (grammar.name == name) return grammar;
    known.append(known.empty() ? "" : ", ").append(grammar.name);
  }
  throw InputError(place + "there is no command '" + std::string(name) + "'; there are " + known);
}

}  // namespace

std::optional<ScriptCommand> parse_script_line(const std::string& text, int line) {
  std::string_view rest = trimmed(text);
  if (rest.empty() || rest.front() == '#') return std::nullopt;
  const std::string place = "script, line " + std::to_string(line) + ": ";
  const Grammar& grammar = grammar_of(take_word(rest), place);
  ScriptCommand command{grammar.verb, ScriptCommand::Target::picture, {}, "", line};
  if (grammar.has_target) command.target = target(take_word(rest), grammar, place);
  if (grammar.has_text) {
    command.text = rest;
    rest = {};
  }
  while (!rest.empty()) command.numbers.push_back(number(take_word(rest), place));
  const auto count = static_cast<int>(command.numbers.size());
  if (count < grammar.least_numbers || count > grammar.most_numbers ||
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

}  // namespace refield
