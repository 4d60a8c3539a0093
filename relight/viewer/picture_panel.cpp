// SPDX-License-Identifier: Apache-2.0
#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "relight/viewer/drawing.h"
#include "relight/viewer/panels.h"
#include "relight/viewer/picture_canvas.h"

namespace refield {

namespace {

PixelPosition pixel_at(const Canvas& canvas, const ImVec2& window) {
  const Point p = canvas.image_from_window({window.x, window.y});
  return {static_cast<int>(std::floor(p.x)), static_cast<int>(std::floor(p.y))};
}

/// Of a scene over a mesh: the left button turns it, and picks where it was not moved.
void handle_camera(App& app, FreeView& view) {
  constexpr float slack_px = 3.0f;
  constexpr double degrees_a_pixel = 0.35;
  const ImGuiIO& io = ImGui::GetIO();
  if (ImGui::IsItemHovered() && io.MouseWheel != 0.0f) view.move().approach(std::pow(1.15, io.MouseWheel));
  const bool is_left = ImGui::IsMouseDown(ImGuiMouseButton_Left);
  const bool was_dragged = ImGui::IsMouseDragging(ImGuiMouseButton_Left, slack_px);
  if (ImGui::IsItemDeactivated() && ImGui::IsMouseReleased(ImGuiMouseButton_Left) && !app.is_dragging)
    app.state->pick(pixel_at(app.picture, io.MousePos));
  app.is_dragging = ImGui::IsItemActive() && (app.is_dragging || was_dragged);
  if (!ImGui::IsItemActive() || (is_left && !app.is_dragging)) return;
  if (io.MouseDelta.x == 0.0f && io.MouseDelta.y == 0.0f) return;
  if (is_left && !io.KeyShift)
    view.move().orbit(-degrees_a_pixel * io.MouseDelta.x, degrees_a_pixel * io.MouseDelta.y);
  else
    view.move().pan(io.MouseDelta.x, io.MouseDelta.y);
}

void handle_picture_mouse(App& app) {
  if (FreeView* view = app.state->view()) return handle_camera(app, *view);
  const ImGuiIO& io = ImGui::GetIO();
  if (ImGui::IsItemHovered() && io.MouseWheel != 0.0f)
    app.picture.zoom_about({io.MousePos.x, io.MousePos.y}, std::pow(1.2, io.MouseWheel));
  if (!ImGui::IsItemActive()) return;
  if (ImGui::IsMouseDown(ImGuiMouseButton_Left))
    app.state->pick(pixel_at(app.picture, io.MousePos));
  else if (io.MouseDelta.x != 0.0f || io.MouseDelta.y != 0.0f)
    app.picture.pan(io.MouseDelta.x, io.MouseDelta.y);
}

/// A ring around the picked pixel, which itself stays free.
void draw_mark(const App& app) {
  const auto& picked = app.state->picked();
  if (!picked) return;
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const ImVec2 middle = vector(app.picture.window_from_image({picked->x + 0.5, picked->y + 0.5}));
  const auto radius = static_cast<float>(std::max(7.0, 0.8 * app.picture.scale()));
  constexpr int smooth = 32;
  list.AddCircle(middle, radius, shadow_colour, smooth, 4.0f);
  list.AddCircle(middle, radius, accent_colour, smooth, 2.0f);
}

void draw_shown_legend(const App& app, const Area& area) {
  const ViewState& state = *app.state;
  if (state.shown() == Shown::picture) return;
  char low[48] = "0 %", high[48];
  if (state.shown() == Shown::false_colour) {
    std::snprintf(low, sizeof low, "−%.0f stops", stops_below_white);
    std::snprintf(high, sizeof high, "white +%.0f", stops_above_white);
  } else {
    std::snprintf(high, sizeof high, "%.3g %%", 100.0 * state.error_range());
  }
  constexpr double width = 260.0, height = 48.0, margin = 12.0;
  draw_legend({area.x + margin, area.y + area.height - height - margin, width, height}, low, high);
}

/// What is shown, where it is not simply the picture.
void draw_title(const App& app, const Area& area) {
  const ViewState& state = *app.state;
  const Point corner{area.x + 12.0, area.y + 12.0};
  if (state.probed()) {
    char text[120];
    std::snprintf(text, sizeof text, "Contribution of texels %d, %d + %d×%d", state.probed()->x0,
                  state.probed()->y0, state.probed()->width(), state.probed()->height());
    draw_plate(corner, text, accent_colour);
    return;
  }
  switch (state.shown()) {
    case Shown::picture:
      return;
    case Shown::false_colour:
      draw_plate(corner, "Luminance in stops", text_colour);
      return;
    case Shown::predicted_error:
      draw_plate(corner, "Predicted relative error on new photographs", text_colour);
      return;
    case Shown::photograph_noise:
      draw_plate(corner, "Part caused by photograph noise", text_colour);
      return;
    case Shown::training_error:
      draw_plate(corner, "Relative error on the training photographs", text_colour);
      return;
  }
}

}  // namespace

void draw_picture_panel(App& app, const Textures& textures, const Area& area) {
  if (FreeView* view = app.state->view()) fill_area(area, app.picture, *view);
  const Image& picture = app.state->radiance();
  begin_picture_panel(area, app.picture, picture);
  handle_picture_mouse(app);
  draw_picture(app.picture, picture, textures.picture);
  draw_mark(app);
  draw_shown_legend(app, area);
  draw_title(app, area);
  end_panel();
}

}  // namespace refield
