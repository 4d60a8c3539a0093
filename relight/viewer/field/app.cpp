// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/field/app.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "core/base/errors.h"
#include "core/base/number_text.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/image_io.h"
#include "relight/environment/environment.h"
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
  app.recent.add(opened.file);
  app.state->probe(std::nullopt);
  app.state->expose_light();
  app.state->expose_picture();
  if (!app.tells_share) say(app, app.light_name + (opened.note.empty() ? "" : ": " + opened.note));
}

void show_opened(App& app, OpenedFile opened) {
  if (opened.state) {
    app.state = std::move(opened.state);
    app.field_file = opened.file;
    app.recent.add(opened.file);
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
                           std::uint64_t large_from_bytes, const std::vector<MonitorPlacement>& monitors) {
  OpenedFile opened{.file = field};
  if (auto large = FieldSampler::open(field, run, large_from_bytes))
    opened.state = std::make_unique<ViewState>(std::move(large), run);
  else
    opened.state =
        std::visit([&](auto content) { return std::make_unique<ViewState>(std::move(content), run); },
                   read_either_field(field, run));
  const FieldOutline& shown = opened.state->field();
  if (!monitors.empty()) check_placements(monitors, shown.basis.domain, "--monitor");
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

void save_light(App& app, const fs::path& file) {
  app.state->refresh();
  save_image(app, file, app.state->light().radiance, {app.state->light_exposure()});
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

}  // namespace refield
