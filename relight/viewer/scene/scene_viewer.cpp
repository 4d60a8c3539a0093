// SPDX-License-Identifier: Apache-2.0
#define GLFW_INCLUDE_NONE

#include <GLFW/glfw3.h>
#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/base/run_context.h"
#include "relight/viewer/field/free_view.h"
#include "relight/viewer/gui/background_job.h"
#include "relight/viewer/gui/gl_window.h"
#include "relight/viewer/gui/input.h"
#include "relight/viewer/gui/widgets.h"
#include "relight/viewer/gui/window_state.h"
#include "relight/viewer/scene/scene_state.h"
#include "relight/viewer/viewer.h"

namespace refield {

namespace {

/// What the left button holds: a thing by one of its points, or the camera.
struct HeldThing {
  std::optional<std::size_t> thing;
  Eigen::Vector3f point = Eigen::Vector3f::Zero();
  Point pointer;             ///< in the window, when it was moved last
  bool is_dragging = false;  ///< further than a click may shake
};

/// The viewer of moving scenes between frames. Panels and shortcuts change it.
struct SceneApp : WindowState {
  SceneApp(MovingScene scene, const RunContext& context) : state(std::move(scene)) { run = context; }

  SceneState state;
  std::optional<std::size_t> selected;  ///< thing
  bool is_playing = false;              ///< the scene's own motion
  std::optional<HeldThing> held;

  Canvas picture;
};

/// Changes the selected thing, where there is one.
template <class Change>
void change_handling(SceneApp& app, const Change& change) {
  if (!app.selected) return;
  Handling handling = app.state.handling(*app.selected);
  change(handling);
  app.state.handle(*app.selected, handling);
}

/// The picture at rest as it is (.exr), or tone-mapped (.png).
void save_scene_picture(SceneApp& app, const std::filesystem::path& file) {
  app.state.view().settle();
  app.state.refresh();
  save_image(app, file, app.state.radiance(), app.state.tone());
}

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
  if (app.selected && app.state.scene().things[*app.selected].is_area_light)
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

const std::vector<Shortcut<SceneApp>>& scene_shortcuts() {
  static const std::vector<Shortcut<SceneApp>> all = make_scene_shortcuts();
  return all;
}

constexpr double margin = 8.0, status = 30.0, side = 380.0;

constexpr const char* scene_mouse_help =
    "Drag moving objects and area lights over the floor; with Shift, up and down. Select other objects with "
    "a click first. Drag elsewhere to rotate the scene, wheel to zoom, right button to pan.";

Point pointer() {
  return {ImGui::GetIO().MousePos.x, ImGui::GetIO().MousePos.y};
}

Eigen::Vector2f image_point(const Canvas& canvas, const Point& window) {
  const Point p = canvas.image_from_window(window);
  return {static_cast<float>(p.x), static_cast<float>(p.y)};
}

std::optional<SceneState::Seen> seen_under_pointer(const SceneApp& app) {
  const Eigen::Vector2f p = image_point(app.picture, pointer());
  return app.state.seen_at(static_cast<int>(std::floor(p.x())), static_cast<int>(std::floor(p.y())));
}

/// What moves by itself or shines can be taken at once, walls and floors only once they are selected: else
/// there would be nowhere to take the camera by.
void take_hold(SceneApp& app) {
  app.held.emplace().pointer = pointer();
  const auto seen = seen_under_pointer(app);
  if (!seen) return;
  const SceneThing& thing = app.state.scene().things[seen->thing];
  if (!thing.moves && !thing.is_area_light && app.selected != seen->thing) return;
  app.selected = app.held->thing = seen->thing;
  app.held->point = seen->point;
}

void drag_held(SceneApp& app) {
  constexpr double degrees_a_pixel = 0.35;
  HeldThing& held = *app.held;
  const Point before = std::exchange(held.pointer, pointer());
  const double right = held.pointer.x - before.x, down = held.pointer.y - before.y;
  FreeView& view = app.state.view();
  const bool with_shift = ImGui::GetIO().KeyShift;
  if (held.thing) {
    const Eigen::Vector3f shift = dragged_shift(view.camera(), held.point, image_point(app.picture, before),
                                                image_point(app.picture, held.pointer),
                                                with_shift ? DragPlane::upright : DragPlane::level);
    held.point += shift;
    app.state.put(*held.thing, app.state.middle(*held.thing) + shift);
  } else if (with_shift) {
    view.move().pan(right, down);
  } else {
    view.move().orbit(-degrees_a_pixel * right, degrees_a_pixel * down);
  }
}

void handle_scene_mouse(SceneApp& app) {
  constexpr float slack_px = 3.0f;
  const ImGuiIO& io = ImGui::GetIO();
  if (ImGui::IsItemHovered() && io.MouseWheel != 0.0f)
    app.state.view().move().approach(std::pow(1.15, io.MouseWheel));
  const bool is_left = ImGui::IsMouseDown(ImGuiMouseButton_Left);
  if (ImGui::IsItemActivated() && is_left) take_hold(app);
  if (app.held && !is_left) {
    if (!app.held->is_dragging && ImGui::IsItemHovered()) {
      const auto seen = seen_under_pointer(app);
      app.selected = seen ? std::optional(seen->thing) : std::nullopt;
    }
    app.held.reset();
  }
  if (!ImGui::IsItemActive() || (io.MouseDelta.x == 0.0f && io.MouseDelta.y == 0.0f)) return;
  if (app.held) {
    if (!app.held->is_dragging && !ImGui::IsMouseDragging(ImGuiMouseButton_Left, slack_px)) return;
    app.held->is_dragging = true;
    drag_held(app);
  } else {
    app.state.view().move().pan(io.MouseDelta.x, io.MouseDelta.y);
  }
}

/// A ring where the middle of the selected thing is seen, and its name.
void draw_selection(const SceneApp& app) {
  if (!app.selected) return;
  const auto place = app.state.view().camera().image_point(app.state.middle(*app.selected));
  if (!place) return;
  const Point p = app.picture.window_from_image({place->x(), place->y()});
  if (!app.picture.area().holds(p.x, p.y)) return;
  ImDrawList& list = *ImGui::GetWindowDrawList();
  constexpr int smooth = 32;
  constexpr float radius = 9.0f;
  list.AddCircle(vector(p), radius, shadow_colour, smooth, 4.0f);
  list.AddCircle(vector(p), radius, accent_colour, smooth, 2.0f);
  draw_plate({p.x + 14.0, p.y - 12.0}, app.state.scene().things[*app.selected].name.c_str(), accent_colour);
}

void draw_scene_picture(SceneApp& app, const Texture& texture, const Area& area) {
  fill_area(area, app.picture, app.state.view());
  const Image& picture = app.state.radiance();
  begin_picture_panel(area, app.picture, picture.width, picture.height);
  handle_scene_mouse(app);
  draw_picture(app.picture, {{0, 0, picture.width, picture.height}, 1}, texture);
  draw_selection(app);
  end_panel();
}

void motion_section(SceneApp& app) {
  SceneState& state = app.state;
  heading("MOTION");
  if (state.scene().duration > 0.0) {
    if (button("Play", app.is_playing)) app.is_playing = !app.is_playing;
    ImGui::SameLine();
  }
  if (button("Start over")) state.start_over();
  if (state.scene().duration > 0.0) {
    label("Time");
    auto time = static_cast<float>(state.time());
    if (ImGui::SliderFloat("##time", &time, 0.0f, static_cast<float>(state.scene().duration), "%.2f s"))
      state.set_time(time);
  }
  label("Bounces");
  int bounces = state.bounces();
  if (ImGui::SliderInt("##bounces", &bounces, 0, SceneState::max_bounces)) state.set_bounces(bounces);
}

void things_section(SceneApp& app) {
  heading("OBJECTS AND AREA LIGHTS");
  const float right = ImGui::GetWindowPos().x + ImGui::GetWindowContentRegionMax().x;
  const auto& things = app.state.scene().things;
  for (std::size_t thing = 0; thing < things.size(); ++thing) {
    const float width = ImGui::CalcTextSize(things[thing].name.c_str()).x +
                        2.0f * ImGui::GetStyle().FramePadding.x + ImGui::GetStyle().ItemSpacing.x;
    if (thing > 0 && ImGui::GetItemRectMax().x + width < right) ImGui::SameLine();
    if (button(things[thing].name.c_str(), app.selected == thing)) app.selected = thing;
  }
  if (!app.selected) return;
  SceneState& state = app.state;
  const SceneThing& thing = things[*app.selected];
  ImGui::Dummy(ImVec2(0.0f, 2.0f));
  label("Position");
  Eigen::Vector3f middle = state.middle(*app.selected);
  if (ImGui::DragFloat3("##position", middle.data(), 0.01f, 0.0f, 0.0f, "%.2f"))
    state.put(*app.selected, middle);
  if (thing.can_turn) {
    label("Turn");
    auto degrees = static_cast<float>(state.handling(*app.selected).turn_degrees);
    if (ImGui::SliderFloat("##turn", &degrees, -180.0f, 180.0f, "%.0f°"))
      change_handling(app, [=](Handling& handling) { handling.turn_degrees = degrees; });
  }
  if (thing.is_area_light) {
    double gain = state.handling(*app.selected).gain;
    if (stops_slider("Brighter", "##gain", gain, -8.0f, 8.0f))
      change_handling(app, [=](Handling& handling) { handling.gain = gain; });
  }
  if (button("Reset object")) change_handling(app, [](Handling& handling) { handling = {}; });
}

void draw_scene_controls(SceneApp& app, const Area& area) {
  begin_panel("##controls", area, true);
  window_buttons(app, "scene");
  heading("PICTURE");
  ToneMapping tone = app.state.tone();
  if (tone_controls(tone)) app.state.set_tone(tone);
  if (button("Auto-expose")) app.state.expose();
  ImGui::SameLine();
  if (button("Reset camera")) app.state.view().move().reset();
  motion_section(app);
  things_section(app);
  end_panel();
}

/// Draws all of a frame into Dear ImGui and lets mouse and controls change `app`.
void draw_scene_panels(SceneApp& app, const Texture& picture) {
  const ImVec2 window = ImGui::GetIO().DisplaySize;
  const double height = window.y - 2.0 * margin - status, width = window.x - side - 3.0 * margin;
  const Area left{margin, margin, width, height};
  const Area picture_area = app.shows_help ? above_help(app, left) : left;
  draw_scene_picture(app, picture, picture_area);
  draw_scene_controls(app, {width + 2.0 * margin, margin, side, height});
  draw_status_bar(app, {0.0, window.y - status, window.x, status}, app.state.scene().name,
                  pointer_text(app.picture, app.state.radiance(), "pixel"));
  draw_notice(app, picture_area);
  if (app.shows_help) draw_help(app, left, scene_mouse_help, keys_of(scene_shortcuts()));
  draw_file_dialog(app, left, [&](const std::filesystem::path& file) { save_scene_picture(app, file); });
}

FrameTime draw_scene(SceneApp& app, Texture& picture) {
  draw_scene_panels(app, picture);
  const SceneState::Refreshed done = app.state.refresh();
  const Image& seen = app.state.radiance();
  if (done.picture) picture.update(seen.width, seen.height, app.state.picture());
  return done.time;
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
  GlWindow window(options.width, options.height);
  if (!opened) {
    window.set_title(name + " – refield");
    const auto is_done = [&](std::chrono::milliseconds wait) { return reading.wait_for(wait); };
    if (!show_message_until(window, "Precomputing the light transport of " + name, is_done, run)) return;
    opened = reading.take();
  }
  SceneApp& app = *opened;
  Texture picture;  // gone before the window
  run_window(window, {.state = app,
                      .title = [&] { return app.state.scene().name; },
                      .wants_frame = [&] { return app.state.view().wants_rest(); },
                      .is_moving = [&] { return app.is_playing; },
                      .advance = [&](double seconds) { app.state.advance(seconds); },
                      .handle = [&](const InputEvent& event) { handle_in_scene(app, event); },
                      .draw = [&] { return draw_scene(app, picture); }});
}

}  // namespace refield
