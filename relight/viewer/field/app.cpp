// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/field/app.h"

#define GLFW_INCLUDE_NONE

#include <GLFW/glfw3.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "core/base/number_text.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/image_io.h"
#include "relight/environment/environment.h"
#include "relight/viewer/field/free_view.h"
#include "relight/viewer/field/light_painter.h"

namespace refield {

namespace fs = std::filesystem;

namespace {

/// What puts a map of the environment onto the field's light map; nothing for other maps, and for those
/// that differ from the field's in size alone.
std::shared_ptr<const EnvironmentProjector> projector_for(LightMap& map, const LightDomain& domain,
                                                          const std::vector<MonitorPlacement>& monitors,
                                                          const RunContext& run) {
  const auto kind = environment_kind(map.radiance.width, map.radiance.height);
  if (!kind || map.domain() == domain || *kind == domain.parameterisation ||
      (domain.parameterisation == Parameterisation::monitor && monitors.empty()))
    return nullptr;
  map.parameterisation = *kind;
  return std::make_shared<const EnvironmentProjector>(domain, monitors, run);
}

void show_light(App& app, OpenedLight opened) {
  LightSetup& setup = app.state->setup();
  const bool is_monitor = setup.domain().parameterisation == Parameterisation::monitor;
  if (!setup.has_map()) {
    setup.remove_all();
    setup.set_ambient(0.0);
    app.selected.reset();
  }
  setup.set_map(std::nullopt);
  setup.set_turns(0.0);
  app.tells_share = opened.environment && is_monitor;
  if (opened.environment)
    setup.set_environment(std::move(opened.environment), std::move(opened.projector));
  else
    setup.set_map(std::move(opened.map));
  app.light_name = opened.file.filename().string();
  app.light_file = opened.file;
  app.state->probe(std::nullopt);
  app.state->expose_light();
  app.state->expose_picture();
  if (!app.tells_share) say(app, app.light_name + (opened.note.empty() ? "" : ": " + opened.note));
}

void show_opened(App& app, OpenedFile opened) {
  if (opened.state) {
    app.state = std::move(opened.state);
    app.field_file = opened.file;
    app.light_name.clear();
    app.selected.reset();
    app.tells_share = false;
  }
  if (opened.light) show_light(app, *std::move(opened.light));
}

void tell_share(App& app) {
  if (!app.tells_share || !app.state->is_current()) return;
  app.tells_share = false;
  say(app,
      app.light_name +
          formatted(": %.1f %% of its light comes from the directions of the monitor; rotate it for more",
                    100.0 * app.state->share().energy));
}

}  // namespace

OpenedFile read_light_file(const fs::path& file, const LightDomain& domain,
                           const std::vector<MonitorPlacement>& monitors, const RunContext& run) {
  OpenedLight opened;
  opened.file = file;
  opened.map = read_light_map(file, domain.parameterisation, run);
  opened.projector = projector_for(opened.map, domain, monitors, run);
  if (opened.projector) {
    opened.environment = std::make_shared<const PreparedEnvironment>(std::move(opened.map), run);
  } else {
    FittedLight fitted = fit_light(opened.map.radiance, domain);
    opened.map = std::move(fitted.light);
    opened.note = std::move(fitted.note);
  }
  return {.file = file, .light = std::move(opened)};
}

OpenedFile read_field_file(const fs::path& field, const std::optional<fs::path>& light, const RunContext& run,
                           const std::vector<MonitorPlacement>& monitors) {
  OpenedFile opened{.file = field};
  if (auto large = FieldSampler::open(field, run))
    opened.state = std::make_unique<ViewState>(std::move(large), run);
  else
    opened.state =
        std::visit([&](auto content) { return std::make_unique<ViewState>(std::move(content), run); },
                   read_either_field(field, run));
  const FieldOutline& shown = opened.state->field();
  if (!monitors.empty()) check_placements(monitors, shown.basis.domain, "--placement");
  if (light)
    opened.light =
        read_light_file(*light, shown.basis.domain, monitors.empty() ? shown.monitors : monitors, run).light;
  return opened;
}

App::App(OpenedFile field, const RunContext& context) {
  run = context;
  show_opened(*this, std::move(field));
}

void open_file(App& app, const fs::path& file) {
  if (app.opening) {
    app.opening->cancel();
    app.abandoned.push_back(std::move(app.opening));
  }
  const FieldOutline& shown = app.state->field();
  app.opening = std::make_unique<BackgroundJob<OpenedFile>>(
      [file, domain = shown.basis.domain, monitors = app.monitors.empty() ? shown.monitors : app.monitors,
       run = app.run] {
        if (file.extension() == ".rfield") return read_field_file(file, std::nullopt, run);
        return read_light_file(file, domain, monitors, run);
      });
  app.opening_name = file.filename().string();
}

void take_opened(App& app) {
  std::erase_if(app.abandoned, [](const auto& job) { return job->wait_for(std::chrono::microseconds(0)); });
  tell_share(app);
  constexpr std::chrono::milliseconds pause(15);  // frames that show nothing new must not slow the reading
  if (!app.opening || !app.opening->wait_for(pause)) return;
  const auto job = std::exchange(app.opening, nullptr);
  app.opening_name.clear();
  try {
    OpenedFile opened = job->take();
    if (opened.state) say(app, opened.file.filename().string());
    show_opened(app, std::move(opened));
  } catch (const Error& error) {
    complain(app, error.what());
  }
}

bool is_busy(const App& app) {
  return app.opening || app.tells_share || app.state->is_reading() || !app.state->is_current();
}

void save_picture(App& app, const fs::path& file) {
  ViewState& state = *app.state;
  if (FreeView* view = state.view()) view->settle();
  state.refresh();
  save_image(app, file, state.radiance(), state.tone_in_use(), state.field().colour_space);
  const PixelGrid grid = state.grid();
  const Box all{0, 0, state.image_width(), state.image_height()};
  if (grid.stride == 1 && grid.region == all) return;
  say(app, "Saved " + file.string() + ": pixels at a stride of " + std::to_string(grid.stride) + " of " +
               std::to_string(grid.region.width()) + "×" + std::to_string(grid.region.height()) + " from " +
               std::to_string(grid.region.x0) + ", " + std::to_string(grid.region.y0) +
               "; 'refield relight' writes all pixels");
}

void change_exposure(App& app, double stops) {
  ToneMapping tone = app.state->tone();
  tone.exposure *= std::exp2(stops);
  app.state->set_tone(tone);
}

void turn_light(App& app, double degrees) {
  try {
    LightSetup& setup = app.state->setup();
    setup.set_turns(setup.turns() + degrees / 360.0);
  } catch (const Error& error) {
    complain(app, error.what());
  }
}

void select_light_source_beside(App& app, int step) {
  const auto count = static_cast<int>(app.state->setup().light_sources().size());
  if (count == 0) return app.selected.reset();
  const int next = app.selected ? static_cast<int>(*app.selected) + step : 0;
  app.selected = static_cast<std::size_t>((next + count) % count);
}

void add_light_source_and_select(App& app, PaintedLight::Shape shape) {
  PaintedLight light_source;
  light_source.shape = shape;
  if (shape == PaintedLight::Shape::bar) light_source.size = 0.125;  // the paper's
  app.selected = app.state->setup().add(light_source);
}

void change_selected(App& app, const std::function<void(PaintedLight&)>& change) {
  LightSetup& setup = app.state->setup();
  if (!app.selected || *app.selected >= setup.light_sources().size()) return;
  PaintedLight light_source = setup.light_sources()[*app.selected];
  change(light_source);
  light_source.size = std::clamp(light_source.size, 0.002, 1.0);
  light_source.y = std::clamp(light_source.y, 0.0, 1.0);
  if (setup.domain().parameterisation != Parameterisation::monitor)
    light_source.x -= std::floor(light_source.x);
  else
    light_source.x = std::clamp(light_source.x, 0.0, 1.0);
  setup.change(*app.selected, light_source);
}

void remove_selected(App& app) {
  if (!app.selected) return;
  app.state->setup().remove(*app.selected);
  app.selected.reset();
}

void advance_motion(App& app, double seconds) {
  if (!app.is_playing) return;
  constexpr double turns_a_second = 1.0 / 12.0, sweeps_a_second = 0.15;
  LightSetup& setup = app.state->setup();
  if (setup.can_turn()) setup.set_turns(setup.turns() + turns_a_second * seconds);
  for (std::size_t i = 0; i < setup.light_sources().size(); ++i) {
    if (app.selected && *app.selected != i) continue;  // the selected one alone, or all
    PaintedLight light_source = setup.light_sources()[i];
    light_source.x += sweeps_a_second * seconds * (i % 2 == 0 ? 1.0 : -1.0);
    light_source.x -= std::floor(light_source.x);
    setup.change(i, light_source);
  }
}

void probe_at(App& app, const Point& texel) {
  const LightDomain& domain = app.state->setup().domain();
  const int width = std::min(app.probe_texels, domain.width),
            height = std::min(app.probe_texels, domain.height);
  const auto start = [](double middle, int length, int all) {
    return std::clamp(static_cast<int>(std::floor(middle - 0.5 * (length - 1))), 0, all - length);
  };
  const int x = start(texel.x, width, domain.width), y = start(texel.y, height, domain.height);
  app.state->probe(Box{x, y, x + width, y + height});
}

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

}  // namespace

const std::vector<Shortcut<App>>& shortcuts() {
  static const std::vector<Shortcut<App>> all = make_shortcuts();
  return all;
}

}  // namespace refield
