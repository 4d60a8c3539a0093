// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/field/app.h"

#define GLFW_INCLUDE_NONE

#include <GLFW/glfw3.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "core/base/errors.h"
#include "relight/viewer/field/free_view.h"

namespace refield {

namespace {

constexpr double third_of_a_stop = 1.0 / 3.0;
constexpr double light_source_step = 0.01;
constexpr double growth = 1.1;
constexpr double turn_step_degrees = 5.0;

void move_selected(App& app, double dx, double dy) {
  change_selected(app, [=](PaintedLight& light_source) {
    light_source.x += dx;
    light_source.y += dy;
  });
}

void scale_selected(App& app, double factor) {
  change_selected(app, [=](PaintedLight& light_source) { light_source.size *= factor; });
}

void show(App& app, Shown shown) {
  try {
    app.state->show(shown);
  } catch (const Error& error) {
    complain(app, error.what());
  }
}

void next_operator(App& app) {
  const ToneMapping tone = app.state->tone();
  app.state->set_tone({tone.exposure, next(tone.curve)});
}

/// Lets go of one thing at a time.
void leave(App& app) {
  if (app.dialog)
    app.dialog.reset();
  else if (app.shows_help)
    app.shows_help = false;
  else if (app.probes || app.state->probed()) {
    app.probes = false;
    app.state->probe(std::nullopt);
  } else if (app.state->picked())
    app.state->pick(std::nullopt);
  else
    app.selected.reset();
}

void save_pictures(App& app) {
  save_both(app, "relit", [&](const std::filesystem::path& file) { save_picture(app, file); });
}

void fit(App& app) {
  if (FreeView* view = app.state->view()) view->move().reset();
  app.picture.fit();
}

std::vector<Shortcut<App>> make_shortcuts() {
  const std::string light_sources = "Area lights", light = "Light map", picture = "Image", rest = "General";
  return {
      {{light_sources, "B", GLFW_KEY_B, false, "add a bar"},
       [](App& a) { add_light_source_and_select(a, PaintedLight::Shape::bar); }},
      {{light_sources, "N", GLFW_KEY_N, false, "add a spot"},
       [](App& a) { add_light_source_and_select(a, PaintedLight::Shape::spot); }},
      {{light_sources, "Tab", GLFW_KEY_TAB, false, "select the next area light"},
       [](App& a) { select_light_source_beside(a, 1); }},
      {{light_sources, "Left", GLFW_KEY_LEFT, false, "move it left"},
       [](App& a) { move_selected(a, -light_source_step, 0.0); }},
      {{light_sources, "Right", GLFW_KEY_RIGHT, false, "move it right"},
       [](App& a) { move_selected(a, light_source_step, 0.0); }},
      {{light_sources, "Up", GLFW_KEY_UP, false, "move it up"},
       [](App& a) { move_selected(a, 0.0, -light_source_step); }},
      {{light_sources, "Down", GLFW_KEY_DOWN, false, "move it down"},
       [](App& a) { move_selected(a, 0.0, light_source_step); }},
      {{light_sources, "]", GLFW_KEY_RIGHT_BRACKET, false, "larger"},
       [](App& a) { scale_selected(a, growth); }},
      {{light_sources, "[", GLFW_KEY_LEFT_BRACKET, false, "smaller"},
       [](App& a) { scale_selected(a, 1.0 / growth); }},
      {{light_sources, "O", GLFW_KEY_O, false, "switch it on or off"},
       [](App& a) {
         change_selected(a, [](PaintedLight& light_source) { light_source.is_on = !light_source.is_on; });
       }},
      {{light_sources, "Delete", GLFW_KEY_DELETE, false, "remove it"}, remove_selected},
      {{light, ".", GLFW_KEY_PERIOD, false, "turn by 5°"}, [](App& a) { turn_light(a, turn_step_degrees); }},
      {{light, ",", GLFW_KEY_COMMA, false, "turn back"}, [](App& a) { turn_light(a, -turn_step_degrees); }},
      {{light, "Space", GLFW_KEY_SPACE, false, "start or stop the light motion"},
       [](App& a) { a.is_playing = !a.is_playing; }},
      {{light, "P", GLFW_KEY_P, false, "probe: contribution of a region"},
       [](App& a) {
         a.probes = !a.probes;
         if (!a.probes) a.state->probe(std::nullopt);
       }},
      {{light, "K", GLFW_KEY_K, false, "show or hide kernels"},
       [](App& a) { a.shows_kernels = !a.shows_kernels; }},
      {{picture, "1", GLFW_KEY_1, false, "the relit scene"}, [](App& a) { show(a, Shown::picture); }},
      {{picture, "2", GLFW_KEY_2, false, "false colour"}, [](App& a) { show(a, Shown::false_colour); }},
      {{picture, "3", GLFW_KEY_3, false, "predicted error"}, [](App& a) { show(a, Shown::predicted_error); }},
      {{picture, "E", GLFW_KEY_E, false, "brighter by ⅓ stop"},
       [](App& a) { change_exposure(a, third_of_a_stop); }},
      {{picture, "D", GLFW_KEY_D, false, "darker by ⅓ stop"},
       [](App& a) { change_exposure(a, -third_of_a_stop); }},
      {{picture, "A", GLFW_KEY_A, false, "auto-expose"},
       [](App& a) {
         a.state->expose_picture();
         a.state->expose_light();
       }},
      {{picture, "T", GLFW_KEY_T, false, "next tone curve"}, next_operator},
      {{picture, "F", GLFW_KEY_F, false, "fit; reset camera"}, fit},
      {{picture, "Z", GLFW_KEY_Z, false, "pixel for pixel"}, [](App& a) { a.picture.zoom_to(1.0); }},
      {{picture, "X", GLFW_KEY_X, false, "smooth or square pixels"},
       [](App& a) { a.is_smooth = !a.is_smooth; }},
      {{rest, "S", GLFW_KEY_S, false, "screenshot, view-0001.png"},
       [](App& a) { a.wants_screenshot = true; }},
      {{rest, "W", GLFW_KEY_W, false, "save as relit-0001.exr and .png"}, save_pictures},
      {{rest, "R", GLFW_KEY_R, false, "reset the area lights"},
       [](App& a) {
         a.selected.reset();
         a.state->reset_light_sources();
       }},
      {{rest, "F1", GLFW_KEY_F1, false, "this help"}, [](App& a) { a.shows_help = !a.shows_help; }},
      {{rest, "Escape", GLFW_KEY_ESCAPE, false, "close, deselect"}, leave},
      {{rest, "Shift+Q", GLFW_KEY_Q, true, "quit"}, [](App& a) { a.wants_to_close = true; }},
  };
}

using Verb = ScriptCommand::Verb;

/// `"pixels": {…}`: those of the image that are shown.
std::string pixels_text(const PixelGrid& grid) {
  const Box& region = grid.region;
  return "\"pixels\": {\"region\": [" + std::to_string(region.x0) + ", " + std::to_string(region.y0) + ", " +
         std::to_string(region.x1) + ", " + std::to_string(region.y1) +
         "], \"stride\": " + std::to_string(grid.stride) + "}";
}

/// Where things are, for tests that look into screenshots: one line of JSON on standard output.
void print_places(const App& app) {
  const ViewState& state = *app.state;
  const LightDomain& light = state.panorama().shown();
  const std::string picked = state.picked() ? "[" + std::to_string(state.picked()->x) + ", " +
                                                  std::to_string(state.picked()->y) + "]"
                                            : "null";
  std::printf(
      "{\"image\": %s, \"light\": %s, \"picked\": %s, \"kernels\": %zu, \"light_sources\": %zu, \"turn\": "
      "%.6f, "
      "\"exposure\": %.9g, \"notice\": %s, %s, %s}\n",
      canvas_text(app.picture, state.image_width(), state.image_height()).c_str(),
      canvas_text(app.light, light.width, light.height).c_str(), picked.c_str(), state.kernels().size(),
      state.setup().light_sources().size(), 360.0 * state.setup().turns(), state.tone_in_use().exposure,
      app.notice && app.notice->is_error ? "\"error\"" : "null", controls_text(app).c_str(),
      (state.view() != nullptr ? camera_text(state.view()->camera()) : pixels_text(state.grid())).c_str());
  std::fflush(stdout);
}

void perform(App& app, const ScriptCommand& command) {
  ViewState& state = *app.state;
  switch (command.verb) {
    case Verb::pan:
      if (FreeView* view = state.view()) return view->move().pan(command.numbers[0], command.numbers[1]);
      return app.picture.pan(command.numbers[0], command.numbers[1]);
    case Verb::where:
      return print_places(app);
    case Verb::save:
      return save_picture(app, command.text);
    case Verb::save_light:
      return save_light(app, command.text);
    default:
      return;  // mouse and keys
  }
}

}  // namespace

const std::vector<Shortcut<App>>& shortcuts() {
  static const std::vector<Shortcut<App>> all = make_shortcuts();
  return all;
}

ScriptStage field_stage(App& app) {
  return {.window_point =
              [&app](ScriptCommand::Target target, double x, double y) {
                const Canvas& canvas = target == ScriptCommand::Target::picture ? app.picture : app.light;
                return canvas.window_from_image({x, y});
              },
          .key = [](const std::string& name) { return key_named(keys_of(shortcuts()), name); },
          .perform = [&app](const ScriptCommand& command) { perform(app, command); },
          .is_opening = [&app] { return app.opening != nullptr; },
          .is_current = [&app] { return !is_busy(app); }};
}

}  // namespace refield
