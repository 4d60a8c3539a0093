// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/viewer.h"

#include "core/errors.h"
#include "relight/viewer/field_script.h"
#include "relight/viewer/panels.h"
#include "relight/viewer/shortcuts.h"
#include "relight/viewer/window_loop.h"

namespace refield {

namespace {

FrameTime draw(App& app, Textures& textures) {
  draw_panels(app, textures);
  const ViewState::Refreshed done = app.state->refresh();
  const ViewState& state = *app.state;
  const LightDomain& light = state.panorama().shown();
  if (done.picture) textures.picture.update(state.radiance().width, state.radiance().height, state.picture());
  if (done.light) textures.light.update(light.width, light.height, state.light_picture());
  if (done.kernels) textures.kernels.update(light.width, light.height, state.kernel_picture());
  textures.picture.set_smooth(app.is_smooth);
  return {.relight_ms = done.relight_ms, .tone_ms = done.tone_ms, .view_ms = done.view_ms};
}

void handle(App& app, const InputEvent& event) {
  if (const auto* dropped = std::get_if<FilesDropped>(&event))
    for (const auto& file : dropped->files) open_file(app, file);
  if (const auto* key = std::get_if<KeyChanged>(&event)) handle_key(shortcuts(), app, *key);
}

}  // namespace

bool has_viewer() {
  return true;
}

void run_viewer(const std::filesystem::path& field, const std::optional<std::filesystem::path>& light,
                const WindowOptions& options) {
  App app(field);
  GlWindow window(options.width, options.height, !options.script);
  Textures textures;  // gone before the window
  if (light) load_light(app, *light);
  run_window(window, options.script,
             {.state = app,
              .title = [&] { return app.field_file.filename().string(); },
              .wants_frame = [&] { return app.state->view() != nullptr && app.state->view()->wants_rest(); },
              .is_moving = [&] { return app.is_playing; },
              .advance = [&](double seconds) { advance_motion(app, seconds); },
              .handle = [&](const InputEvent& event) { handle(app, event); },
              .draw = [&] { return draw(app, textures); },
              .stage = field_stage(app)});
}

}  // namespace refield
