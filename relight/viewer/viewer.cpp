// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/viewer.h"

#include "relight/viewer/field/app.h"
#include "relight/viewer/gui/gl_window.h"

namespace refield {

namespace {

/// So long a frame waits for the background, which most often is done by then: a picture follows the hand in
/// the same frame.
constexpr std::chrono::milliseconds patience(25);
/// Files that take longer to read are waited for in the window.
constexpr std::chrono::milliseconds patience_before_window(150);

/// The picture in the light that the panels set up so far, and its textures.
FrameTime refresh(App& app, Textures& textures) {
  ViewState::Refreshed done;
  try {
    app.state->look_at(visible_region(app));
    done = app.state->refresh(patience);
  } catch (const Error& error) {
    complain(app, error.what());
  }
  const ViewState& state = *app.state;
  const LightDomain& light = state.panorama().shown();
  if (done.picture) textures.picture.update(state.radiance().width, state.radiance().height, state.picture());
  if (done.light) textures.light.update(light.width, light.height, state.light_picture());
  if (done.kernels) textures.kernels.update(light.width, light.height, state.kernel_picture());
  textures.picture.set_smooth(app.is_smooth);
  return done.time;
}

FrameTime draw(App& app, Textures& textures) {
  take_opened(app);
  FrameTime time;
  draw_panels(app, textures, [&] { time = refresh(app, textures); });
  return time;
}

void handle(App& app, const InputEvent& event) {
  if (const auto* dropped = std::get_if<FilesDropped>(&event))
    for (const auto& file : dropped->files) open_file(app, file);
  if (const auto* key = std::get_if<KeyChanged>(&event)) handle_key(shortcuts(), app, *key);
}

}  // namespace

void run_viewer(const std::filesystem::path& field, const std::optional<std::filesystem::path>& light,
                const WindowOptions& options, const RunContext& run) {
  BackgroundJob<OpenedFile> reading(
      [=, monitors = options.monitors] { return read_field_file(field, light, run, monitors); });
  std::optional<OpenedFile> opened;
  if (reading.wait_for(patience_before_window)) opened = reading.take();  // errors come before a window
  GlWindow window(options.width, options.height);
  if (!opened) {
    const auto is_done = [&](std::chrono::milliseconds wait) { return reading.wait_for(wait); };
    if (!show_message_until(window, "Reading " + field.filename().string(), is_done, run)) return;
    opened = reading.take();
  }
  App app(*std::move(opened), run);
  app.monitors = options.monitors;
  Textures textures;  // gone before the window
  run_window(
      window,
      {.state = app,
       .title = [&] { return app.field_file.filename().string(); },
       .wants_frame =
           [&] { return is_busy(app) || (app.state->view() != nullptr && app.state->view()->wants_rest()); },
       .is_moving = [&] { return app.is_playing; },
       .advance = [&](double seconds) { advance_motion(app, seconds); },
       .handle = [&](const InputEvent& event) { handle(app, event); },
       .draw = [&] { return draw(app, textures); }});
}

}  // namespace refield
