// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/script_player.h"

#include <cmath>
#include <cstdio>

#include "core/errors.h"
#include "relight/viewer/shortcuts.h"

namespace refield {

namespace {

using Verb = ScriptCommand::Verb;
using Target = ScriptCommand::Target;

constexpr int settling_frames = 2;
constexpr int usual_drag_frames = 30;

/// The middle of a pixel or texel, in the window.
MouseMoved over(const App& app, Target target, double x, double y) {
  const Canvas& canvas = target == Target::picture ? app.picture : app.light;
  const Point p = canvas.window_from_image({x + 0.5, y + 0.5});
  return {p.x, p.y};
}

[[noreturn]] void fail(const ScriptCommand& command, const std::string& what) {
  throw InputError("script, line " + std::to_string(command.line) + ": " + what);
}

Point control_named(const App& app, const ScriptCommand& command) {
  const auto found = app.controls.find(command.text);
  if (found != app.controls.end()) return found->second;
  std::string known;
  for (const auto& [name, place] : app.controls) known.append(known.empty() ? "" : ", ").append(name);
  fail(command, "there is no control '" + command.text + "' now; there are " + known);
}

/// Empty where there is none.
std::string camera_text(const FreeView* view) {
  if (view == nullptr) return "";
  const PinholeCamera& camera = view->camera();
  const Eigen::Vector3f &p = camera.position, &t = camera.target;
  char text[200];
  std::snprintf(text, sizeof text,
                R"(, "camera": {"position": [%.7g, %.7g, %.7g], "target": [%.7g, %.7g, %.7g], "fov": %.7g})",
                p.x(), p.y(), p.z(), t.x(), t.y(), t.z(), camera.vertical_field_of_view_degrees);
  return text;
}

/// Where things are, for tests that look into screenshots: one line of JSON on standard output.
void print_places(const App& app) {
  const auto canvas_text = [](const Canvas& canvas, int width, int height) {
    char text[160];
    std::snprintf(text, sizeof text, R"({"x": %.3f, "y": %.3f, "scale": %.9f, "width": %d, "height": %d})",
                  canvas.origin().x, canvas.origin().y, canvas.scale(), width, height);
    return std::string(text);
  };
  const ViewState& state = *app.state;
  const LightDomain& light = state.panorama().shown();
  const std::string picked = state.picked() ? "[" + std::to_string(state.picked()->x) + ", " +
                                                  std::to_string(state.picked()->y) + "]"
                                            : "null";
  std::printf(
      "{\"image\": %s, \"light\": %s, \"picked\": %s, \"kernels\": %zu, \"lamps\": %zu, \"turn\": %.6f, "
      "\"exposure\": %.9g, \"notice\": %s%s}\n",
      canvas_text(app.picture, state.radiance().width, state.radiance().height).c_str(),
      canvas_text(app.light, light.width, light.height).c_str(), picked.c_str(), state.kernels().size(),
      state.painter().lamps().size(), 360.0 * state.painter().turns(), state.tone_in_use().exposure,
      app.notice && app.notice->is_error ? "\"error\"" : "null", camera_text(state.view()).c_str());
  std::fflush(stdout);
}

}  // namespace

void ScriptPlayer::plan_waiting(int frames) {
  for (int i = 0; i < frames; ++i) steps_.push_back([](App&, InputQueue&) {});
}

void ScriptPlayer::plan_click(const ScriptCommand& command, MouseButton button) {
  const bool holds = command.verb == Verb::probe;
  const Target target = holds ? Target::light : Target::picture;
  steps_.push_back([=, at = command.numbers](App& app, InputQueue& input) {
    input.push(over(app, target, at[0], at[1]));
  });
  plan_waiting(1);
  steps_.push_back([=](App&, InputQueue& input) { input.push(MouseButtonChanged{button, true}); });
  plan_waiting(1);
  if (!holds)
    steps_.push_back([=](App&, InputQueue& input) { input.push(MouseButtonChanged{button, false}); });
  plan_waiting(settling_frames);
}

void ScriptPlayer::plan_drag(const ScriptCommand& command) {
  const auto& at = command.numbers;
  const int frames = at.size() > 4 ? static_cast<int>(at[4]) : usual_drag_frames;
  if (frames < 1) fail(command, "a drag takes 1 frame or more");
  const auto go_to = [&](double x, double y) {
    steps_.push_back(
        [=, target = command.target](App& app, InputQueue& input) { input.push(over(app, target, x, y)); });
  };
  go_to(at[0], at[1]);
  plan_waiting(1);
  steps_.push_back([](App&, InputQueue& input) { input.push(MouseButtonChanged{MouseButton::left, true}); });
  for (int i = 1; i <= frames; ++i) {
    const double t = static_cast<double>(i) / frames;
    go_to(at[0] + t * (at[2] - at[0]), at[1] + t * (at[3] - at[1]));
  }
  steps_.push_back([](App&, InputQueue& input) { input.push(MouseButtonChanged{MouseButton::left, false}); });
  plan_waiting(settling_frames);
}

void ScriptPlayer::plan_setting(const ScriptCommand& command) {
  steps_.push_back([command](App& app, InputQueue&) {
    ToneMapping tone = app.state->tone();
    if (command.verb == Verb::rotate)
      turn_light(app, command.numbers[0] - 360.0 * app.state->painter().turns());
    if (command.verb == Verb::exposure) tone.exposure = std::exp2(command.numbers[0]);
    if (command.verb == Verb::curve) tone.curve = tone_operator_from_name(command.text);
    if (command.verb == Verb::show) app.state->show(shown_from_name(command.text));
    app.state->set_tone(tone);
  });
  plan_waiting(settling_frames);
}

void ScriptPlayer::plan_camera(const ScriptCommand& command) {
  steps_.push_back([command](App& app, InputQueue&) {
    FreeView* view = app.state->view();
    if (view == nullptr) fail(command, "the field has no mesh for a camera to move around");
    const auto& n = command.numbers;
    if (command.verb == Verb::approach && !(n[0] > 0.0)) fail(command, "give a factor above zero");
    if (command.verb == Verb::orbit) view->move().orbit(n[0], n[1]);
    if (command.verb == Verb::approach) view->move().approach(n[0]);
    if (command.verb == Verb::pan) view->move().pan(n[0], n[1]);
  });
  plan_waiting(settling_frames);
}

void ScriptPlayer::plan_output(const ScriptCommand& command) {
  plan_waiting(1);
  steps_.push_back([this, command](App& app, InputQueue&) {
    if (command.verb == Verb::fps) {
      std::printf("%s\n", text_of(frame_statistics(frames_)).c_str());
      std::fflush(stdout);
      frames_.clear();
    }
    if (command.verb == Verb::where) print_places(app);
    if (command.verb == Verb::screenshot) screenshot_ = command.text;
    if (command.verb == Verb::save) save_picture(app, command.text);
    if (command.verb == Verb::save_light) save_light(app, command.text);
    if (command.verb == Verb::quit) app.wants_to_close = true;
  });
}

void ScriptPlayer::plan(const ScriptCommand& command) {
  switch (command.verb) {
    case Verb::load:
      steps_.push_back([=](App&, InputQueue& input) { input.push(FilesDropped{{command.text}}); });
      return plan_waiting(settling_frames);
    case Verb::move:
      steps_.push_back([=](App& app, InputQueue& input) {
        input.push(over(app, command.target, command.numbers[0], command.numbers[1]));
      });
      return plan_waiting(settling_frames);
    case Verb::pick:
      return plan_click(command, MouseButton::left);
    case Verb::probe:
      return plan_click(command, MouseButton::right);
    case Verb::drag:
      return plan_drag(command);
    case Verb::scroll:
      steps_.push_back([=](App& app, InputQueue& input) {
        input.push(over(app, command.target, command.numbers[0], command.numbers[1]));
        input.push(MouseScrolled{0.0, command.numbers[2]});
      });
      return plan_waiting(settling_frames);
    case Verb::release:
      steps_.push_back([](App&, InputQueue& input) {
        for (const auto button : {MouseButton::left, MouseButton::right, MouseButton::middle})
          input.push(MouseButtonChanged{button, false});
      });
      return plan_waiting(settling_frames + 2);
    case Verb::press:
      steps_.push_back([=](App& app, InputQueue& input) {
        const Point p = control_named(app, command);
        input.push(MouseMoved{p.x, p.y});
      });
      plan_waiting(1);
      steps_.push_back([](App&, InputQueue& input) {
        input.push(MouseButtonChanged{MouseButton::left, true});
        input.push(MouseButtonChanged{MouseButton::left, false});
      });
      return plan_waiting(settling_frames + 1);
    case Verb::key:
      steps_.push_back([=](App&, InputQueue& input) {
        KeyChanged key = key_named(command.text);
        input.push(key);
        key.is_down = false;
        input.push(key);
      });
      return plan_waiting(settling_frames);
    case Verb::orbit:
    case Verb::approach:
    case Verb::pan:
      return plan_camera(command);
    case Verb::rotate:
    case Verb::exposure:
    case Verb::curve:
    case Verb::show:
      return plan_setting(command);
    case Verb::wait:
      return plan_waiting(static_cast<int>(command.numbers[0]));
    case Verb::fps:
    case Verb::where:
    case Verb::screenshot:
    case Verb::save:
    case Verb::save_light:
    case Verb::quit:
      return plan_output(command);
  }
}

bool ScriptPlayer::step(App& app, InputQueue& input) {
  while (steps_.empty()) {
    const auto command = source_.next();
    if (!command) return false;
    plan(*command);
  }
  const Step next = std::move(steps_.front());
  steps_.pop_front();
  next(app, input);
  return true;
}

}  // namespace refield
