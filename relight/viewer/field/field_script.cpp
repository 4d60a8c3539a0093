// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/field/field_script.h"

#include <cmath>
#include <cstdio>

#include "core/base/errors.h"
#include "relight/viewer/field/free_view.h"
#include "relight/viewer/gui/shortcuts.h"

namespace refield {

namespace {

using Verb = ScriptCommand::Verb;

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
      "\"exposure\": %.9g, \"notice\": %s, %s%s}\n",
      canvas_text(app.picture, state.radiance().width, state.radiance().height).c_str(),
      canvas_text(app.light, light.width, light.height).c_str(), picked.c_str(), state.kernels().size(),
      state.setup().light_sources().size(), 360.0 * state.setup().turns(), state.tone_in_use().exposure,
      app.notice && app.notice->is_error ? "\"error\"" : "null", controls_text(app).c_str(),
      state.view() != nullptr ? (", " + camera_text(state.view()->camera())).c_str() : "");
  std::fflush(stdout);
}

void perform(App& app, const ScriptCommand& command) {
  ViewState& state = *app.state;
  switch (command.verb) {
    case Verb::rotate:
      return turn_light(app, command.numbers[0] - 360.0 * state.setup().turns());
    case Verb::exposure:
      return state.set_tone({std::exp2(command.numbers[0]), state.tone().curve});
    case Verb::curve:
      return state.set_tone({state.tone().exposure, tone_operator_from_name(command.text)});
    case Verb::show:
      return state.show(shown_from_name(command.text));
    case Verb::orbit:
    case Verb::approach:
    case Verb::pan:
      if (state.view() == nullptr) throw InputError("the field has no mesh for a camera to move around");
      return move_camera(state.view()->move(), command);
    case Verb::where:
      return print_places(app);
    case Verb::save:
      return save_picture(app, command.text);
    case Verb::save_light:
      return save_light(app, command.text);
    default:
      throw InputError("this command requires a dynamic scene, but a field is shown");
  }
}

}  // namespace

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
