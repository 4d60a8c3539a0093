// SPDX-License-Identifier: Apache-2.0
#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "core/tone_map.h"
#include "relight/viewer/drawing.h"
#include "relight/viewer/panels.h"

namespace refield {

namespace {

/// A point of the map in fractions of its width and height.
Point fraction_at(const App& app, const ImVec2& window) {
  const Point texel = app.light.image_from_window({window.x, window.y});
  const LightDomain& domain = app.state->panorama().shown();
  return {texel.x / domain.width, texel.y / domain.height};
}

Point window_at(const App& app, double x, double y) {
  const LightDomain& domain = app.state->panorama().shown();
  return app.light.window_from_image({x * domain.width, y * domain.height});
}

/// The left button takes the lamp under it, or the map itself.
void handle_drag(App& app) {
  const ImGuiIO& io = ImGui::GetIO();
  if (ImGui::IsItemActivated()) {
    const Point at = fraction_at(app, io.MousePos);
    app.selected = app.state->setup().lamp_at(at.x, at.y);
    return;
  }
  if (io.MouseDelta.x == 0.0f && io.MouseDelta.y == 0.0f) return;
  const LightDomain& domain = app.state->panorama().shown();
  const double dx = io.MouseDelta.x / (app.light.scale() * domain.width);
  const double dy = io.MouseDelta.y / (app.light.scale() * domain.height);
  if (app.selected)
    change_selected(app, [=](Lamp& lamp) {
      lamp.x += dx;
      lamp.y += dy;
    });
  else if (app.state->setup().can_turn())
    turn_light(app, 360.0 * dx);
}

void handle_wheel(App& app) {
  const ImGuiIO& io = ImGui::GetIO();
  if (io.MouseWheel == 0.0f) return;
  if (app.probes || app.state->probed()) {
    const double wanted = app.probe_texels * std::pow(1.3, io.MouseWheel);
    const int texels = io.MouseWheel > 0.0f ? static_cast<int>(std::ceil(wanted)) : static_cast<int>(wanted);
    app.probe_texels = std::clamp(texels, 1, 256);
    return;
  }
  const Point at = fraction_at(app, io.MousePos);
  if (const auto lamp = app.state->setup().lamp_at(at.x, at.y)) app.selected = lamp;
  change_selected(app, [&](Lamp& lamp) { lamp.size *= std::pow(1.1, io.MouseWheel); });
}

void handle_mouse(App& app) {
  const ImGuiIO& io = ImGui::GetIO();
  const bool is_probing =
      ImGui::IsItemActive() && (ImGui::IsMouseDown(ImGuiMouseButton_Right) ||
                                (app.probes && ImGui::IsMouseDown(ImGuiMouseButton_Left)));
  if (is_probing)
    probe_at(app,
             app.state->panorama().texel_at(app.light.image_from_window({io.MousePos.x, io.MousePos.y})));
  else if (app.state->probed() && !app.probes)
    app.state->probe(std::nullopt);
  if (!is_probing && ImGui::IsItemActive() && ImGui::IsMouseDown(ImGuiMouseButton_Left)) handle_drag(app);
  if (!ImGui::IsItemHovered()) return;
  handle_wheel(app);
  const Point at = fraction_at(app, io.MousePos);
  if (!app.probes && app.state->setup().lamp_at(at.x, at.y)) ImGui::SetMouseCursor(ImGuiMouseCursor_Hand);
}

ImU32 colour_of(const Lamp& lamp) {
  const float brightest = std::max({lamp.colour[0], lamp.colour[1], lamp.colour[2], 1e-6f});
  std::array<float, 3> encoded;
  for (int c = 0; c < 3; ++c) encoded[c] = srgb_from_linear(lamp.colour[c] / brightest);
  return ImGui::ColorConvertFloat4ToU32(ImVec4(encoded[0], encoded[1], encoded[2], 1.0f));
}

/// Its outline, and a handle of its colour in the middle.
void draw_lamp(const App& app, const Lamp& lamp, bool is_selected) {
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const LightDomain& domain = app.state->panorama().shown();
  const ImU32 line = is_selected ? accent_colour : 0x90ffffff;
  const float thickness = is_selected ? 2.0f : 1.0f;
  constexpr int smooth = 48;
  Point middle = window_at(app, lamp.x, lamp.y);
  if (lamp.shape == Lamp::Shape::bar) {
    middle.y = window_at(app, 0.0, 0.5).y;
    for (const double side : {-0.5, 0.5}) {
      const double x = lamp.x + side * lamp.size;
      list.AddLine(vector(window_at(app, x, 0.0)), vector(window_at(app, x, 1.0)), shadow_colour,
                   thickness + 2.0f);
      list.AddLine(vector(window_at(app, x, 0.0)), vector(window_at(app, x, 1.0)), line, thickness);
    }
  } else {
    const auto radius = static_cast<float>(std::max(lamp.size * domain.height * app.light.scale(), 3.0));
    list.AddCircle(vector(middle), radius, shadow_colour, smooth, thickness + 2.0f);
    list.AddCircle(vector(middle), radius, line, smooth, thickness);
  }
  list.AddCircleFilled(vector(middle), is_selected ? 6.0f : 5.0f, 0xff101010);
  list.AddCircleFilled(vector(middle), is_selected ? 4.5f : 3.5f, lamp.is_on ? colour_of(lamp) : 0xff505050);
}

/// The picked pixel's kernels: their density over the map, rectangles framed the stronger the more energy
/// they hold.
void draw_kernels(const App& app, const Textures& textures, const ImVec2& corner, const ImVec2& far_corner) {
  ImDrawList& list = *ImGui::GetWindowDrawList();
  list.AddImage(textures.kernels.handle(), corner, far_corner, ImVec2(0, 0), ImVec2(1, 1), 0xe8ffffff);
  for (const PixelKernel& kernel : app.state->kernels()) {
    // On a panorama a cube's squares have no straight edges.
    if (kernel.hat || kernel.energy_share <= 0.0 || app.state->panorama().is_cube()) continue;
    const Box& box = kernel.support;
    const auto alpha = static_cast<ImU32>(40.0 + 215.0 * std::sqrt(kernel.energy_share));
    list.AddRect(
        vector(app.light.window_from_image({static_cast<double>(box.x0), static_cast<double>(box.y0)})),
        vector(app.light.window_from_image({static_cast<double>(box.x1), static_cast<double>(box.y1)})),
        alpha << 24 | 0x00ffffff);
  }
  char text[80];
  const bool is_mesh = app.state->view() != nullptr;
  std::snprintf(text, sizeof text, is_mesh ? "Kernels of the vertex at %d, %d" : "Kernels of pixel %d, %d",
                app.state->picked()->x, app.state->picked()->y);
  draw_plate({app.light.area().x + 8.0, app.light.area().y + 8.0}, text, accent_colour);
}

void draw_probe(const App& app) {
  const auto& box = app.state->probed();
  if (!box || app.state->panorama().is_cube()) return;  // there it is under the pointer
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const ImVec2 a =
      vector(app.light.window_from_image({static_cast<double>(box->x0), static_cast<double>(box->y0)}));
  const ImVec2 b =
      vector(app.light.window_from_image({static_cast<double>(box->x1), static_cast<double>(box->y1)}));
  constexpr float margin = 4.0f;
  list.AddRect(ImVec2(a.x - margin, a.y - margin), ImVec2(b.x + margin, b.y + margin), shadow_colour, 0.0f, 0,
               4.0f);
  list.AddRect(ImVec2(a.x - margin, a.y - margin), ImVec2(b.x + margin, b.y + margin), accent_colour, 0.0f, 0,
               2.0f);
}

}  // namespace

void draw_light_panel(App& app, const Textures& textures, const Area& area) {
  const LightDomain& domain = app.state->panorama().shown();
  app.light.fit();
  app.light.lay_out(area, domain.width, domain.height);
  begin_panel("##light", area, false);
  ImGui::InvisibleButton("##canvas", ImGui::GetContentRegionAvail(),
                         ImGuiButtonFlags_MouseButtonLeft | ImGuiButtonFlags_MouseButtonRight);
  handle_mouse(app);
  ImDrawList& list = *ImGui::GetWindowDrawList();
  list.AddRectFilled(vector({area.x, area.y}), vector({area.x + area.width, area.y + area.height}),
                     canvas_colour, 6.0f);
  const ImVec2 corner = vector(app.light.window_from_image({0.0, 0.0}));
  const ImVec2 far_corner = vector(window_at(app, 1.0, 1.0));
  list.AddImage(textures.light.handle(), corner, far_corner);
  list.PushClipRect(corner, far_corner, true);
  const bool shows_kernels = app.shows_kernels && app.state->picked();
  if (shows_kernels) draw_kernels(app, textures, corner, far_corner);
  const auto& lamps = app.state->setup().lamps();
  for (std::size_t i = 0; i < lamps.size(); ++i)
    if (!shows_kernels || app.selected == i) draw_lamp(app, lamps[i], app.selected == i);
  draw_probe(app);
  list.PopClipRect();
  end_panel();
}

}  // namespace refield
