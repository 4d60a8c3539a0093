// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/scene/scene_panels.h"

#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/errors.h"
#include "relight/viewer/drawing.h"
#include "relight/viewer/file_dialog.h"
#include "relight/viewer/picture_canvas.h"
#include "relight/viewer/scene/drag.h"
#include "relight/viewer/widgets.h"
#include "relight/viewer/window_panels.h"

namespace refield {

namespace {

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
  if (!thing.moves && !thing.is_lamp && app.selected != seen->thing) return;
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
  begin_picture_panel(area, app.picture, picture);
  handle_scene_mouse(app);
  draw_picture(app.picture, picture, texture);
  draw_selection(app);
  end_panel();
}

void motion_section(SceneApp& app) {
  SceneState& state = app.state;
  heading("MOTION");
  if (state.scene().duration > 0.0) {
    if (button(app, "Play", app.is_playing)) app.is_playing = !app.is_playing;
    ImGui::SameLine();
  }
  if (button(app, "Start over")) state.start_over();
  if (state.scene().duration > 0.0) {
    label("Time");
    auto time = static_cast<float>(state.time());
    if (ImGui::SliderFloat("##time", &time, 0.0f, static_cast<float>(state.scene().duration), "%.2f s"))
      state.set_time(time);
  }
  label("Bounces");
  int bounces = state.bounces();
  if (ImGui::SliderInt("##bounces", &bounces, 0, SceneState::most_bounces)) state.set_bounces(bounces);
}

void things_section(SceneApp& app) {
  heading("OBJECTS AND LAMPS");
  const float right = ImGui::GetWindowPos().x + ImGui::GetWindowContentRegionMax().x;
  const auto& things = app.state.scene().things;
  for (std::size_t thing = 0; thing < things.size(); ++thing) {
    const float width = ImGui::CalcTextSize(things[thing].name.c_str()).x +
                        2.0f * ImGui::GetStyle().FramePadding.x + ImGui::GetStyle().ItemSpacing.x;
    if (thing > 0 && ImGui::GetItemRectMax().x + width < right) ImGui::SameLine();
    if (button(app, things[thing].name.c_str(), app.selected == thing)) app.selected = thing;
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
  if (thing.is_lamp) {
    double gain = state.handling(*app.selected).gain;
    if (stops_slider("Brighter", "##gain", gain, -8.0f, 8.0f))
      change_handling(app, [=](Handling& handling) { handling.gain = gain; });
  }
  if (button(app, "Reset object")) change_handling(app, [](Handling& handling) { handling = {}; });
}

void draw_scene_controls(SceneApp& app, const Area& area) {
  begin_panel("##controls", area, true);
  app.controls.clear();
  window_buttons(app, "scene");
  heading("PICTURE");
  ToneMapping tone = app.state.tone();
  if (tone_controls(app, tone)) app.state.set_tone(tone);
  if (button(app, "Auto-expose")) app.state.expose();
  ImGui::SameLine();
  if (button(app, "Reset camera")) app.state.view().move().reset();
  motion_section(app);
  things_section(app);
  end_panel();
}

void save_to(SceneApp& app, const std::filesystem::path& file) {
  try {
    save_scene_picture(app, file);
  } catch (const Error& error) {
    complain(app, error.what());
  }
}

}  // namespace

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
  draw_file_dialog(app, left, {}, [&](const std::filesystem::path& file) { save_to(app, file); });
}

}  // namespace refield
