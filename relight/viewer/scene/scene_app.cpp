// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/scene/scene_app.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "core/errors.h"
#include "relight/viewer/camera_script.h"

namespace refield {

namespace {

using Verb = ScriptCommand::Verb;

constexpr double third_stop = 1.0 / 3.0;
constexpr double turn_step = 5.0;     // degrees
constexpr double nudge_share = 0.02;  // of the distance from the camera

void nudge(SceneApp& app, const Eigen::Vector3f& direction) {
  if (!app.selected) return;
  const Eigen::Vector3f middle = app.state.middle(*app.selected);
  const float distance = (middle - app.state.view().camera().position).norm();
  app.state.put(*app.selected, middle + static_cast<float>(nudge_share) * distance * direction);
}

void turn(SceneApp& app, double degrees) {
  if (app.selected && app.state.scene().things[*app.selected].can_turn)
    change_handling(app, [=](Handling& handling) { handling.turn_degrees += degrees; });
}

void brighten(SceneApp& app, double stops) {
  if (app.selected && app.state.scene().things[*app.selected].is_lamp)
    change_handling(app, [=](Handling& handling) { handling.gain *= std::exp2(stops); });
}

void expose_by(SceneApp& app, double stops) {
  const ToneMapping tone = app.state.tone();
  app.state.set_tone({tone.exposure * std::exp2(stops), tone.curve});
}

void next_curve(SceneApp& app) {
  const ToneMapping tone = app.state.tone();
  app.state.set_tone({tone.exposure, next(tone.curve)});
}

void save_scene_pictures(SceneApp& app) {
  save_both(app, "scene", [&](const std::filesystem::path& file) { save_scene_picture(app, file); });
}

void let_go(SceneApp& app) {
  if (app.dialog)
    app.dialog.reset();
  else if (app.shows_help)
    app.shows_help = false;
  else
    app.selected.reset();
}

std::vector<Shortcut<SceneApp>> make_scene_shortcuts() {
  using App = SceneApp;
  using V = Eigen::Vector3f;
  const std::string things = "Objects and area lights", motion = "Motion and light", picture = "Image",
                    rest = "General";
  return {
      {{things, "Tab", GLFW_KEY_TAB, false, "select the next"},
       [](App& a) { a.selected = a.selected ? (*a.selected + 1) % a.state.scene().things.size() : 0; }},
      {{things, "Left", GLFW_KEY_LEFT, false, "move it along −X"}, [](App& a) { nudge(a, -V::UnitX()); }},
      {{things, "Right", GLFW_KEY_RIGHT, false, "along +X"}, [](App& a) { nudge(a, V::UnitX()); }},
      {{things, "Up", GLFW_KEY_UP, false, "along +Z"}, [](App& a) { nudge(a, V::UnitZ()); }},
      {{things, "Down", GLFW_KEY_DOWN, false, "along −Z"}, [](App& a) { nudge(a, -V::UnitZ()); }},
      {{things, "PageUp", GLFW_KEY_PAGE_UP, false, "up"}, [](App& a) { nudge(a, V::UnitY()); }},
      {{things, "PageDown", GLFW_KEY_PAGE_DOWN, false, "down"}, [](App& a) { nudge(a, -V::UnitY()); }},
      {{things, ".", GLFW_KEY_PERIOD, false, "turn by 5°"}, [](App& a) { turn(a, turn_step); }},
      {{things, ",", GLFW_KEY_COMMA, false, "turn back"}, [](App& a) { turn(a, -turn_step); }},
      {{things, "]", GLFW_KEY_RIGHT_BRACKET, false, "area light brighter by ⅓ stop"},
       [](App& a) { brighten(a, third_stop); }},
      {{things, "[", GLFW_KEY_LEFT_BRACKET, false, "dimmer"}, [](App& a) { brighten(a, -third_stop); }},
      {{things, "Delete", GLFW_KEY_DELETE, false, "reset object"},
       [](App& a) { change_handling(a, [](Handling& handling) { handling = {}; }); }},
      {{motion, "Space", GLFW_KEY_SPACE, false, "start or stop the scene motion"},
       [](App& a) { a.is_playing = !a.is_playing; }},
      {{motion, "R", GLFW_KEY_R, false, "reset all objects and the time"},
       [](App& a) { a.state.start_over(); }},
      {{motion, "B", GLFW_KEY_B, false, "one bounce more"},
       [](App& a) { a.state.set_bounces(a.state.bounces() + 1); }},
      {{motion, "Shift+B", GLFW_KEY_B, true, "one less"},
       [](App& a) { a.state.set_bounces(a.state.bounces() - 1); }},
      {{picture, "E", GLFW_KEY_E, false, "brighter by ⅓ stop"}, [](App& a) { expose_by(a, third_stop); }},
      {{picture, "D", GLFW_KEY_D, false, "darker by ⅓ stop"}, [](App& a) { expose_by(a, -third_stop); }},
      {{picture, "A", GLFW_KEY_A, false, "auto-expose"}, [](App& a) { a.state.expose(); }},
      {{picture, "T", GLFW_KEY_T, false, "next tone curve"}, next_curve},
      {{picture, "F", GLFW_KEY_F, false, "reset camera"}, [](App& a) { a.state.view().move().reset(); }},
      {{rest, "S", GLFW_KEY_S, false, "screenshot, view-0001.png"},
       [](App& a) { a.wants_screenshot = true; }},
      {{rest, "W", GLFW_KEY_W, false, "save as scene-0001.exr and .png"}, save_scene_pictures},
      {{rest, "F1", GLFW_KEY_F1, false, "this help"}, [](App& a) { a.shows_help = !a.shows_help; }},
      {{rest, "Escape", GLFW_KEY_ESCAPE, false, "close, deselect"}, let_go},
      {{rest, "Shift+Q", GLFW_KEY_Q, true, "quit"}, [](App& a) { a.wants_to_close = true; }},
  };
}

/// One line of JSON on standard output, for tests that look into screenshots.
void print_scene_places(const SceneApp& app) {
  const SceneState& state = app.state;
  nlohmann::ordered_json things = nlohmann::ordered_json::array();
  for (std::size_t thing = 0; thing < state.scene().things.size(); ++thing) {
    const Eigen::Vector3f middle = state.middle(thing);
    const Handling& handling = state.handling(thing);
    things.push_back({{"name", state.scene().things[thing].name},
                      {"middle", {middle.x(), middle.y(), middle.z()}},
                      {"turn", handling.turn_degrees},
                      {"gain", handling.gain}});
  }
  const std::string selected = app.selected ? std::to_string(*app.selected) : "null";
  std::printf(
      "{\"image\": %s, \"time\": %.9g, \"bounces\": %d, \"selected\": %s, \"exposure\": %.9g, %s, "
      "\"things\": %s}\n",
      canvas_text(app.picture, state.radiance().width, state.radiance().height).c_str(), state.time(),
      state.bounces(), selected.c_str(), state.tone().exposure, camera_text(state.view().camera()).c_str(),
      things.dump().c_str());
  std::fflush(stdout);
}

std::size_t selected_thing(const SceneApp& app) {
  if (!app.selected) throw InputError("nothing is selected; write 'select NAME' before");
  return *app.selected;
}

void perform_in_scene(SceneApp& app, const ScriptCommand& command) {
  SceneState& state = app.state;
  const auto& n = command.numbers;
  switch (command.verb) {
    case Verb::select:
      app.selected = thing_named(app, command.text);
      return;
    case Verb::place:
      return state.put(selected_thing(app), Eigen::Vector3d(n[0], n[1], n[2]).cast<float>());
    case Verb::rotate:
      if (!state.scene().things[selected_thing(app)].can_turn)
        throw InputError(state.scene().things[*app.selected].name + " looks at a point and cannot be turned");
      return change_handling(app, [&](Handling& handling) { handling.turn_degrees = n[0]; });
    case Verb::gain:
      if (!state.scene().things[selected_thing(app)].is_lamp)
        throw InputError(state.scene().things[*app.selected].name + " is not an area light");
      return change_handling(app, [&](Handling& handling) { handling.gain = std::exp2(n[0]); });
    case Verb::time:
      return state.set_time(n[0]);
    case Verb::bounces:
      return state.set_bounces(static_cast<int>(n[0]));
    case Verb::exposure:
      return state.set_tone({std::exp2(n[0]), state.tone().curve});
    case Verb::curve:
      return state.set_tone({state.tone().exposure, tone_operator_from_name(command.text)});
    case Verb::orbit:
    case Verb::approach:
    case Verb::pan:
      return move_camera(state.view().move(), command);
    case Verb::where:
      return print_scene_places(app);
    case Verb::save:
      return save_scene_picture(app, command.text);
    default:
      throw InputError("this command requires a field, but a dynamic scene is shown");
  }
}

}  // namespace

std::size_t thing_named(const SceneApp& app, const std::string& name) {
  const auto& things = app.state.scene().things;
  const auto found = std::ranges::find(things, name, &SceneThing::name);
  if (found != things.end()) return static_cast<std::size_t>(found - things.begin());
  std::string known;
  for (const SceneThing& thing : things) known.append(known.empty() ? "" : ", ").append(thing.name);
  throw InputError("the scene has no '" + name + "'; there are " + known);
}

void save_scene_picture(SceneApp& app, const std::filesystem::path& file) {
  app.state.view().settle();
  app.state.refresh();
  save_image(app, file, app.state.radiance(), app.state.tone());
}

const std::vector<Shortcut<SceneApp>>& scene_shortcuts() {
  static const std::vector<Shortcut<SceneApp>> all = make_scene_shortcuts();
  return all;
}

ScriptStage scene_stage(SceneApp& app) {
  return {.window_point =
              [&app](ScriptCommand::Target target, double x, double y) {
                if (target != ScriptCommand::Target::picture)
                  throw InputError("a dynamic scene has no light map; give positions in the image");
                return app.picture.window_from_image({x, y});
              },
          .key = [](const std::string& name) { return key_named(keys_of(scene_shortcuts()), name); },
          .perform = [&app](const ScriptCommand& command) { perform_in_scene(app, command); }};
}

}  // namespace refield
