// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/app.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "core/errors.h"
#include "core/image_io.h"
#include "core/reflectance_field_file.h"
#include "relight/environment.h"
#include "relight/viewer/fit_light.h"

namespace refield {

namespace fs = std::filesystem;

namespace {

void load_field(App& app, const fs::path& file) {
  app.state = std::visit([](auto field) { return std::make_unique<ViewState>(std::move(field)); },
                         read_either_field(file));
  app.field_file = file;
  app.light_name.clear();
  app.selected.reset();
}

/// What puts a map of the surroundings onto the field's light map; nothing for other maps, and for those
/// that differ from the field's in size alone.
std::shared_ptr<const EnvironmentProjector> projector_for(LightMap& map, const ReflectanceField& field) {
  const LightDomain& domain = field.basis.domain;
  const auto kind = environment_kind(map.radiance.width, map.radiance.height);
  if (!kind || map.domain() == domain || *kind == domain.parameterisation ||
      (domain.parameterisation == Parameterisation::monitor && field.monitors.empty()))
    return nullptr;
  map.parameterisation = *kind;
  return std::make_shared<const EnvironmentProjector>(domain, field.monitors);
}

std::string seen_note(const EnvironmentShare& share) {
  char text[96];
  std::snprintf(text, sizeof text, "%.1f %% of its light comes from where the monitor is; turn it for more",
                100.0 * share.energy);
  return text;
}

}  // namespace

App::App(const fs::path& field_path) {
  load_field(*this, field_path);
}

void load_light(App& app, const fs::path& file) {
  LightPainter& painter = app.state->painter();
  const LightDomain& domain = painter.domain();
  LightMap map = read_light_map(file, domain.parameterisation);
  auto projector = projector_for(map, app.state->field());
  FittedLight fitted;
  if (!projector) fitted = fit_light(map.radiance, domain);
  if (!painter.has_map()) {
    painter.remove_all();
    painter.set_ambient(0.0);
    app.selected.reset();
  }
  painter.set_map(std::nullopt);
  painter.set_turns(0.0);
  if (projector) {
    painter.set_surroundings(std::move(map), std::move(projector));
    if (domain.parameterisation == Parameterisation::monitor) fitted.note = seen_note(painter.share());
  } else {
    painter.set_map(std::move(fitted.light));
  }
  app.light_name = file.filename().string();
  app.state->probe(std::nullopt);
  app.state->expose_light();
  app.state->expose_picture();
  say(app, app.light_name + (fitted.note.empty() ? "" : ": " + fitted.note));
}

void open_file(App& app, const fs::path& file) {
  try {
    if (file.extension() == ".rfield") {
      load_field(app, file);
      say(app, file.filename().string());
    } else {
      load_light(app, file);
    }
  } catch (const Error& error) {
    complain(app, error.what());
  }
}

void save_picture(App& app, const fs::path& file) {
  ViewState& state = *app.state;
  if (FreeView* view = state.view()) view->settle();
  state.refresh();
  save_image(app, file, state.radiance(), state.tone_in_use());
}

void save_light(App& app, const fs::path& file) {
  save_image(app, file, app.state->painter().light().radiance, {app.state->light_exposure()});
}

void change_exposure(App& app, double stops) {
  ToneMapping tone = app.state->tone();
  tone.exposure *= std::exp2(stops);
  app.state->set_tone(tone);
}

void turn_light(App& app, double degrees) {
  try {
    LightPainter& painter = app.state->painter();
    painter.set_turns(painter.turns() + degrees / 360.0);
  } catch (const Error& error) {
    complain(app, error.what());
  }
}

void select_lamp_beside(App& app, int step) {
  const auto count = static_cast<int>(app.state->painter().lamps().size());
  if (count == 0) return app.selected.reset();
  const int next = app.selected ? static_cast<int>(*app.selected) + step : 0;
  app.selected = static_cast<std::size_t>((next + count) % count);
}

void add_lamp_and_select(App& app, Lamp::Shape shape) {
  Lamp lamp;
  lamp.shape = shape;
  if (shape == Lamp::Shape::bar) lamp.size = 0.125;  // the paper's
  app.selected = app.state->painter().add(lamp);
}

void change_selected(App& app, const std::function<void(Lamp&)>& change) {
  LightPainter& painter = app.state->painter();
  if (!app.selected || *app.selected >= painter.lamps().size()) return;
  Lamp lamp = painter.lamps()[*app.selected];
  change(lamp);
  lamp.size = std::clamp(lamp.size, 0.002, 1.0);
  lamp.y = std::clamp(lamp.y, 0.0, 1.0);
  if (painter.domain().parameterisation != Parameterisation::monitor)
    lamp.x -= std::floor(lamp.x);
  else
    lamp.x = std::clamp(lamp.x, 0.0, 1.0);
  painter.change(*app.selected, lamp);
}

void remove_selected(App& app) {
  if (!app.selected) return;
  app.state->painter().remove(*app.selected);
  app.selected.reset();
}

void advance_motion(App& app, double seconds) {
  if (!app.is_playing) return;
  constexpr double turns_a_second = 1.0 / 12.0, sweeps_a_second = 0.15;
  LightPainter& painter = app.state->painter();
  if (painter.can_turn()) painter.set_turns(painter.turns() + turns_a_second * seconds);
  for (std::size_t i = 0; i < painter.lamps().size(); ++i) {
    if (app.selected && *app.selected != i) continue;  // the selected one alone, or all
    Lamp lamp = painter.lamps()[i];
    lamp.x += sweeps_a_second * seconds * (i % 2 == 0 ? 1.0 : -1.0);
    lamp.x -= std::floor(lamp.x);
    painter.change(i, lamp);
  }
}

void probe_at(App& app, const Point& texel) {
  const LightDomain& domain = app.state->painter().domain();
  const int width = std::min(app.probe_texels, domain.width),
            height = std::min(app.probe_texels, domain.height);
  const auto start = [](double middle, int length, int all) {
    return std::clamp(static_cast<int>(std::floor(middle - 0.5 * (length - 1))), 0, all - length);
  };
  const int x = start(texel.x, width, domain.width), y = start(texel.y, height, domain.height);
  app.state->probe(Box{x, y, x + width, y + height});
}

}  // namespace refield
