// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/field/field_viewer.h"

#define GLFW_INCLUDE_NONE

#include <GLFW/glfw3.h>

#include "core/base/number_text.h"
#include "core/field_io/reflectance_field_file.h"
#include "relight/environment/environment.h"

namespace refield {

namespace {

/// So long a frame waits for the background, which most often is done by then: a picture follows the hand in
/// the same frame.
constexpr std::chrono::milliseconds patience(25);

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

/// A light map for a field of that domain and those monitors. Throws what the readers throw, and InputError
/// for a map that does not fit.
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

/// A field and, where there is one, a light map to begin with. Of fields whose transfer takes
/// large_transfer_bytes or more, only pixels that a window shows are read. `monitors` stand in place of the
/// field's where there are any. Throws as read_light_file().
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

}  // namespace

FieldViewer::FieldViewer(OpenedFile field, std::vector<MonitorPlacement> monitors, const RunContext& context)
    : ViewerWindow(context, "relit"), monitors_(std::move(monitors)) {
  show_opened(std::move(field));
}

void FieldViewer::show_light(OpenedLight opened) {
  LightSetup& setup = state_->setup();
  const bool is_monitor = setup.domain.parameterisation == Parameterisation::monitor;
  if (!setup.has_map()) {
    setup.light_sources.clear();
    setup.ambient = 0.0;
    selected.reset();
  }
  setup.set_map(std::nullopt);
  setup.set_turns(0.0);
  tells_share_ = opened.environment && is_monitor;
  setup.environment = std::move(opened.environment);
  setup.projector = std::move(opened.projector);
  if (!setup.environment) setup.set_map(std::move(opened.map));
  light_name_ = opened.file.filename().string();
  light_file_ = opened.file;
  state_->probe(std::nullopt);
  state_->expose_light();
  state_->expose_picture();
  if (!tells_share_) say(light_name_ + (opened.note.empty() ? "" : ": " + opened.note));
}

void FieldViewer::show_opened(OpenedFile opened) {
  if (opened.state) {
    state_ = std::move(opened.state);
    field_file_ = opened.file;
    light_name_.clear();
    selected.reset();
    tells_share_ = false;
  }
  if (opened.light) show_light(*std::move(opened.light));
}

void FieldViewer::tell_share() {
  if (!tells_share_ || !state_->is_current()) return;
  tells_share_ = false;
  say(light_name_ +
      formatted(": %.1f %% of its light comes from the directions of the monitor; rotate it for more",
                100.0 * state_->share().energy));
}

void FieldViewer::open(const fs::path& file) {
  if (opening_) {
    opening_->cancel();
    abandoned_.push_back(std::move(opening_));
  }
  const FieldOutline& shown = state_->field();
  opening_ = std::make_unique<BackgroundJob<OpenedFile>>(
      [file, domain = shown.basis.domain, monitors = monitors_.empty() ? shown.monitors : monitors_,
       run = run] {
        if (file.extension() == ".rfield") return read_field_file(file, std::nullopt, run, {});
        return read_light_file(file, domain, monitors, run);
      });
}

void FieldViewer::take_opened() {
  std::erase_if(abandoned_, [](const auto& job) { return job->wait_for(std::chrono::microseconds(0)); });
  tell_share();
  constexpr std::chrono::milliseconds pause(15);  // frames that show nothing new must not slow the reading
  if (!opening_ || !opening_->wait_for(pause)) return;
  const auto job = std::exchange(opening_, nullptr);
  attempt([&] {
    OpenedFile opened = job->take();
    if (opened.state) say(opened.file.filename().string());
    show_opened(std::move(opened));
  });
}

Refreshed FieldViewer::refresh() {
  state_->look_at(visible_region());
  const ViewState::Changed done = state_->refresh(patience);
  const LightDomain& light = state_->panorama().shown();
  if (done.light) light_texture_.update(light.width, light.height, state_->light_picture());
  if (done.kernels) kernel_texture_.update(light.width, light.height, state_->kernel_picture());
  return done;
}

void FieldViewer::save(const fs::path& file) {
  if (FreeView* view = camera()) view->settle();
  state_->refresh();
  write_picture(file, state_->tone_in_use(), state_->field().colour_space);
  const PixelGrid saved = grid();
  if (saved.stride == 1 && saved.region == Box{0, 0, image_size().x, image_size().y}) return;
  say("Saved " + file.string() + ": pixels at a stride of " + std::to_string(saved.stride) + " of " +
      std::to_string(saved.region.width()) + "×" + std::to_string(saved.region.height()) + " from " +
      std::to_string(saved.region.x0) + ", " + std::to_string(saved.region.y0) +
      "; 'refield relight' writes all pixels");
}

void FieldViewer::deselect() {
  if (probes_ || state_->probed()) {
    probes_ = false;
    state_->probe(std::nullopt);
  } else if (state_->picked()) {
    state_->pick(std::nullopt);
  } else {
    selected.reset();
  }
}

void FieldViewer::turn_light(double degrees) {
  LightSetup& setup = state_->setup();
  attempt([&] { setup.set_turns(setup.turns + degrees / 360.0); });
}

void FieldViewer::add_and_select(PaintedLight::Shape shape) {
  PaintedLight light_source;
  light_source.shape = shape;
  if (shape == PaintedLight::Shape::bar) light_source.size = 0.125;  // the paper's
  std::vector<PaintedLight>& all = state_->setup().light_sources;
  selected = all.size();
  all.push_back(light_source);
}

void FieldViewer::change_selected(const std::function<void(PaintedLight&)>& change) {
  LightSetup& setup = state_->setup();
  if (!selected || *selected >= setup.light_sources.size()) return;
  PaintedLight& light_source = setup.light_sources[*selected];
  change(light_source);
  light_source.size = std::clamp(light_source.size, 0.002, 1.0);
  light_source.y = std::clamp(light_source.y, 0.0, 1.0);
  if (setup.domain.parameterisation != Parameterisation::monitor)
    light_source.x -= std::floor(light_source.x);
  else
    light_source.x = std::clamp(light_source.x, 0.0, 1.0);
}

void FieldViewer::remove_selected() {
  std::vector<PaintedLight>& all = state_->setup().light_sources;
  if (selected && *selected < all.size()) all.erase(all.begin() + static_cast<std::ptrdiff_t>(*selected));
  selected.reset();
}

void FieldViewer::advance(double seconds) {
  constexpr double turns_a_second = 1.0 / 12.0, sweeps_a_second = 0.15;
  LightSetup& setup = state_->setup();
  if (setup.can_turn()) setup.set_turns(setup.turns + turns_a_second * seconds);
  for (std::size_t i = 0; i < setup.light_sources.size(); ++i) {
    if (selected && *selected != i) continue;  // the selected one alone, or all
    PaintedLight& light_source = setup.light_sources[i];
    light_source.x += sweeps_a_second * seconds * (i % 2 == 0 ? 1.0 : -1.0);
    light_source.x -= std::floor(light_source.x);
  }
}

void FieldViewer::toggle_probing() {
  probes_ = !probes_;
  if (!probes_) state_->probe(std::nullopt);
}

void FieldViewer::probe_at(const Point& texel) {
  const LightDomain& domain = state_->setup().domain;
  const int width = std::min(probe_texels_, domain.width), height = std::min(probe_texels_, domain.height);
  const auto start = [](double middle, int length, int all) {
    return std::clamp(static_cast<int>(std::floor(middle - 0.5 * (length - 1))), 0, all - length);
  };
  const int x = start(texel.x, width, domain.width), y = start(texel.y, height, domain.height);
  state_->probe(Box{x, y, x + width, y + height});
}

std::vector<Shortcut> FieldViewer::shortcuts() {
  constexpr double step = 0.01, growth = 1.1, turn_step_degrees = 5.0;
  const std::string sources = "Area lights", light = "Light map", picture = "Image";
  const auto move = [this](double dx, double dy) {
    change_selected([=](PaintedLight& light_source) {
      light_source.x += dx;
      light_source.y += dy;
    });
  };
  const auto scale = [this](double factor) {
    change_selected([=](PaintedLight& light_source) { light_source.size *= factor; });
  };
  const auto show = [this](Shown shown) { attempt([&] { state_->show(shown); }); };
  const auto select_next = [this] {
    const std::size_t count = state_->setup().light_sources.size();
    selected = selected && count > 0 ? (*selected + 1) % count : 0;
    if (count == 0) selected.reset();
  };
  return {
      {sources, "B", GLFW_KEY_B, false, "add a bar", [this] { add_and_select(PaintedLight::Shape::bar); }},
      {sources, "N", GLFW_KEY_N, false, "add a spot", [this] { add_and_select(PaintedLight::Shape::spot); }},
      {sources, "Tab", GLFW_KEY_TAB, false, "select the next area light", select_next},
      {sources, "Left", GLFW_KEY_LEFT, false, "move it left", [=] { move(-step, 0.0); }},
      {sources, "Right", GLFW_KEY_RIGHT, false, "move it right", [=] { move(step, 0.0); }},
      {sources, "Up", GLFW_KEY_UP, false, "move it up", [=] { move(0.0, -step); }},
      {sources, "Down", GLFW_KEY_DOWN, false, "move it down", [=] { move(0.0, step); }},
      {sources, "]", GLFW_KEY_RIGHT_BRACKET, false, "larger", [=] { scale(growth); }},
      {sources, "[", GLFW_KEY_LEFT_BRACKET, false, "smaller", [=] { scale(1.0 / growth); }},
      {sources, "O", GLFW_KEY_O, false, "switch it on or off",
       [this] { change_selected([](PaintedLight& source) { source.is_on = !source.is_on; }); }},
      {sources, "Delete", GLFW_KEY_DELETE, false, "remove it", [this] { remove_selected(); }},
      {sources, "R", GLFW_KEY_R, false, "reset the area lights",
       [this] {
         selected.reset();
         state_->reset_light_sources();
       }},
      {light, ".", GLFW_KEY_PERIOD, false, "turn by 5°", [this] { turn_light(turn_step_degrees); }},
      {light, ",", GLFW_KEY_COMMA, false, "turn back", [this] { turn_light(-turn_step_degrees); }},
      {light, "Space", GLFW_KEY_SPACE, false, "start or stop the light motion",
       [this] { is_playing = !is_playing; }},
      {light, "P", GLFW_KEY_P, false, "probe: contribution of a region", [this] { toggle_probing(); }},
      {light, "K", GLFW_KEY_K, false, "show or hide kernels", [this] { shows_kernels_ = !shows_kernels_; }},
      {picture, "1", GLFW_KEY_1, false, "the relit scene", [=] { show(Shown::picture); }},
      {picture, "2", GLFW_KEY_2, false, "false colour", [=] { show(Shown::false_colour); }},
      {picture, "3", GLFW_KEY_3, false, "predicted error", [=] { show(Shown::predicted_error); }},
      {picture, "Z", GLFW_KEY_Z, false, "pixel for pixel", [this] { canvas.zoom_to(1.0); }},
      {picture, "X", GLFW_KEY_X, false, "smooth or square pixels", [this] { is_smooth = !is_smooth; }},
      {picture, "A", GLFW_KEY_A, false, "auto-expose",
       [this] {
         state_->expose_picture();
         state_->expose_light();
       }},
  };
}

void run_viewer(const fs::path& field, const std::optional<fs::path>& light, const WindowOptions& options,
                const RunContext& run) {
  open_window(
      field.filename().string(), "Reading",
      [&] {
        return std::make_unique<FieldViewer>(read_field_file(field, light, run, options.monitors),
                                             options.monitors, run);
      },
      options, run);
}

}  // namespace refield
