// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/script_player.h"

#include <cstdio>

#include "core/errors.h"

namespace refield {

namespace {

using Verb = ScriptCommand::Verb;
using Target = ScriptCommand::Target;

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
  std::string known;
  for (const auto& [label, control] : window.controls) known.append(known.empty() ? "" : ", ").append(label);
  throw InputError("there is no control '" + name + "' now; there are " + known);
}

}  // namespace

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

void ScriptPlayer::plan(const ScriptCommand& command) {
  switch (command.verb) {
    case Verb::load:
      add(command, [=](const Driven& driven) { driven.input.push(FilesDropped{{command.text}}); });
      return plan_waiting(settling_frames);
    case Verb::move:
      add(command, [=](const Driven& driven) {
        driven.input.push(over(driven.stage, command.target, command.numbers[0], command.numbers[1]));
      });
      return plan_waiting(settling_frames);
    case Verb::pick:
      return plan_click(command, MouseButton::left);
    case Verb::probe:
      return plan_click(command, MouseButton::right);
    case Verb::drag:
      return plan_drag(command);
    case Verb::scroll:
      add(command, [=](const Driven& driven) {
        driven.input.push(over(driven.stage, command.target, command.numbers[0], command.numbers[1]));
        driven.input.push(MouseScrolled{0.0, command.numbers[2]});
      });
      return plan_waiting(settling_frames);
    case Verb::release:
      add(command, [](const Driven& driven) {
        for (const auto button : {MouseButton::left, MouseButton::right, MouseButton::middle})
          driven.input.push(MouseButtonChanged{button, false});
      });
      return plan_waiting(settling_frames + 2);
    case Verb::press:
      add(command, [=](const Driven& driven) {
        const Point p = control_named(driven.window, command.text);
        driven.input.push(MouseMoved{p.x, p.y});
      });
      plan_waiting(1);
      add(command, [](const Driven& driven) {
        driven.input.push(MouseButtonChanged{MouseButton::left, true});
        driven.input.push(MouseButtonChanged{MouseButton::left, false});
      });
      return plan_waiting(settling_frames + 1);
    case Verb::key:
      add(command, [=](const Driven& driven) {
        KeyChanged key = driven.stage.key(command.text);
        driven.input.push(key);
        key.is_down = false;
        driven.input.push(key);
      });
      return plan_waiting(settling_frames);
    case Verb::type:
      add(command, [=](const Driven& driven) {
        for (const char c : command.text) driven.input.push(CharacterTyped{static_cast<unsigned char>(c)});
      });
      return plan_waiting(settling_frames);
    case Verb::wait:
      return plan_waiting(static_cast<int>(command.numbers[0]));
    case Verb::fps:
    case Verb::where:
    case Verb::screenshot:
    case Verb::save:
    case Verb::save_light:
    case Verb::quit:
      return plan_output(command);
    default:
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
