// SPDX-License-Identifier: Apache-2.0
#include "core/run_context.h"
#include "relight/viewer/background_job.h"
#include "relight/viewer/scene/moving_scene.h"
#include "relight/viewer/scene/scene_panels.h"
#include "relight/viewer/viewer.h"
#include "relight/viewer/window_loop.h"

namespace refield {

namespace {

FrameTime draw_scene(SceneApp& app, Texture& picture) {
  draw_scene_panels(app, picture);
  const SceneState::Refreshed done = app.state.refresh();
  const Image& seen = app.state.radiance();
  if (done.picture) picture.update(seen.width, seen.height, app.state.picture());
  return {.relight_ms = done.light_ms,
          .tone_ms = done.tone_ms,
          .view_ms = done.view_ms,
          .wait_ms = done.light_ms};
}

void handle_in_scene(SceneApp& app, const InputEvent& event) {
  if (std::holds_alternative<FilesDropped>(event))
    complain(app, "Files cannot be dropped onto a dynamic scene; open them with 'refield view'");
  if (const auto* key = std::get_if<KeyChanged>(&event)) handle_key(scene_shortcuts(), app, *key);
}

}  // namespace

void run_scene_viewer(const std::string& name, const std::function<MovingScene()>& read,
                      const WindowOptions& options, const RunContext& run) {
  BackgroundJob<std::unique_ptr<SceneApp>> reading([&] { return std::make_unique<SceneApp>(read(), run); });
  std::unique_ptr<SceneApp> opened;
  constexpr std::chrono::milliseconds patience_before_window(150);
  if (reading.wait_for(patience_before_window)) opened = reading.take();  // errors come before a window
  GlWindow window(options.width, options.height, !options.script);
  if (!opened) {
    window.set_title(name + " – refield");
    const auto is_done = [&](std::chrono::milliseconds wait) { return reading.wait_for(wait); };
    if (!show_message_until(window, "Precomputing the light transport of " + name, is_done, run)) return;
    opened = reading.take();
  }
  SceneApp& app = *opened;
  Texture picture;  // gone before the window
  run_window(window, options.script,
             {.state = app,
              .title = [&] { return app.state.scene().name; },
              .wants_frame = [&] { return app.state.view().wants_rest(); },
              .is_moving = [&] { return app.is_playing; },
              .advance = [&](double seconds) { app.state.advance(seconds); },
              .handle = [&](const InputEvent& event) { handle_in_scene(app, event); },
              .draw = [&] { return draw_scene(app, picture); },
              .stage = scene_stage(app)});
}

}  // namespace refield
