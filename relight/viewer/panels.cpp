// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/panels.h"

#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "relight/viewer/drawing.h"
#include "relight/viewer/shortcuts.h"

namespace refield {

namespace {

constexpr double gap = 8.0;
constexpr double status_height = 30.0;

/// What lies under the pointer, in the status bar's words.
std::string pointer_text(const App& app) {
  const ImVec2 mouse = ImGui::GetIO().MousePos;
  char text[120] = "";
  const auto write = [&](const Canvas& canvas, const Image& image, const char* what) {
    const Point p = canvas.image_from_window({mouse.x, mouse.y});
    const int x = static_cast<int>(std::floor(p.x)), y = static_cast<int>(std::floor(p.y));
    if (!canvas.area().holds(mouse.x, mouse.y) || x < 0 || y < 0 || x >= image.width || y >= image.height)
      return;
    std::snprintf(text, sizeof text, "%s %d, %d:  %.4g  %.4g  %.4g", what, x, y, image.at(x, y, 0),
                  image.at(x, y, 1), image.at(x, y, 2));
  };
  write(app.picture, app.state->radiance(), "pixel");
  write(app.light, app.state->shown_light(), "texel");
  return text;
}

std::string time_text(const App& app) {
  const FrameStatistics recent = frame_statistics({app.recent_frames.begin(), app.recent_frames.end()});
  if (recent.frames == 0) return "";
  char text[160], view[40] = "";
  if (recent.mean.view_ms > 0.0) std::snprintf(view, sizeof view, "view %.1f ms · ", recent.mean.view_ms);
  std::snprintf(text, sizeof text, "relighting %.1f ms · %stone %.1f ms · drawing %.1f ms · %.0f frames/s",
                recent.mean.relight_ms, view, recent.mean.tone_ms, recent.mean.draw_ms, recent.per_second);
  return text;
}

void help_column(const std::vector<Shortcut>& all, std::size_t first, std::size_t last) {
  std::string group;
  for (std::size_t i = first; i < last; ++i) {
    if (all[i].group != group) {
      group = all[i].group;
      ImGui::Dummy(ImVec2(0.0f, 4.0f));
      ImGui::TextColored(ImGui::ColorConvertU32ToFloat4(accent_colour), "%s", group.c_str());
    }
    ImGui::TextUnformatted(all[i].name.c_str());
    ImGui::SameLine(86.0f);
    ImGui::TextDisabled("%s", all[i].help.c_str());
  }
}

}  // namespace

void draw_panels(App& app, const Textures& textures) {
  const ImVec2 window = ImGui::GetIO().DisplaySize;
  const LightDomain& domain = app.state->panorama().shown();
  const double side = std::clamp(0.32 * window.x, 360.0, 560.0);
  const double inner_height = window.y - 2.0 * gap - status_height;
  const double left_width = window.x - side - 3.0 * gap, right = left_width + 2.0 * gap;
  const double light_height =
      std::min(side * domain.height / domain.width, std::max(140.0, 0.42 * inner_height));
  const Area picture{gap, gap, left_width, inner_height};
  draw_picture_panel(app, textures, picture);
  draw_light_panel(app, textures, {right, gap, side, light_height});
  draw_control_panel(app, {right, gap + light_height + gap, side, inner_height - light_height - gap});
  draw_status_bar(app, {0.0, window.y - status_height, window.x, status_height});
  draw_notice(app, picture);
  if (app.shows_help) draw_help(app, {0.0, 0.0, window.x, window.y});
}

void draw_status_bar(const App& app, const Area& area) {
  ImDrawList& list = *ImGui::GetBackgroundDrawList();
  const double top = area.y + 0.5 * (area.height - ImGui::GetTextLineHeight());
  const ReflectanceField& field = app.state->field();
  const std::string name =
      app.field_file.filename().string() + "   " +
      (field.mesh.empty() ? std::to_string(field.width) + "×" + std::to_string(field.height)
                          : std::to_string(field.mesh.positions.size()) + " vertices");
  list.AddText(vector(area.x + 14.0, top), text_colour, name.c_str());
  const std::string pointer = pointer_text(app), time = time_text(app);
  list.AddText(vector(area.x + 0.27 * area.width, top), 0xff909090, pointer.c_str());
  list.AddText(vector(area.x + area.width - 14.0 - ImGui::CalcTextSize(time.c_str()).x, top), 0xff909090,
               time.c_str());
}

void draw_notice(App& app, const Area& area) {
  if (!app.notice) return;
  if (std::chrono::steady_clock::now() > app.notice->until) {
    app.notice.reset();
    return;
  }
  const double width = std::min(620.0, area.width - 40.0);
  ImGui::SetNextWindowPos(vector(area.x + 0.5 * area.width, area.y + 20.0), 0, ImVec2(0.5f, 0.0f));
  ImGui::SetNextWindowSizeConstraints(ImVec2(0, 0), vector(width, area.height));
  ImGui::PushStyleColor(ImGuiCol_WindowBg, app.notice->is_error ? 0xf0202a60 : 0xf0303030);
  ImGui::Begin("##notice", nullptr,
               ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoInputs | ImGuiWindowFlags_AlwaysAutoResize |
                   ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_NoNav |
                   ImGuiWindowFlags_NoFocusOnAppearing);
  const float wanted = ImGui::CalcTextSize(app.notice->text.c_str()).x;
  ImGui::PushTextWrapPos(std::min(wanted + 14.0f, static_cast<float>(width) - 24.0f));
  ImGui::TextUnformatted(app.notice->text.c_str());
  ImGui::PopTextWrapPos();
  ImGui::End();
  ImGui::PopStyleColor();
}

void draw_help(App& app, const Area& area) {
  const double width = std::min(760.0, area.width - 40.0);
  ImGui::SetNextWindowPos(vector(area.x + 0.5 * area.width, area.y + 0.5 * area.height), 0,
                          ImVec2(0.5f, 0.5f));
  ImGui::SetNextWindowSize(vector(width, 0.0));
  ImGui::SetNextWindowBgAlpha(0.97f);
  ImGui::Begin("##help", &app.shows_help,
               ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_NoMove |
                   ImGuiWindowFlags_NoNav | ImGuiWindowFlags_AlwaysAutoResize);
  ImGui::TextWrapped(
      "Picture: click a pixel to see its kernels over the light map; wheel zooms, right button pans. Scenes "
      "over a mesh: drag turns them, wheel comes nearer, right button or Shift and drag pans.\n"
      "Light map: drag lamps, wheel sizes them; drag beside them to turn the map; hold the right button to "
      "see what that part alone lights, wheel sizes the part.\n"
      "Drop light maps and fields onto the window.");
  const auto& all = shortcuts();
  const auto half = static_cast<std::size_t>(
      std::ranges::find(all, std::string("Picture"), &Shortcut::group) - all.begin());
  ImGui::Columns(2, "##shortcuts", false);
  help_column(all, 0, half);
  ImGui::NextColumn();
  help_column(all, half, all.size());
  ImGui::Columns(1);
  ImGui::End();
}

}  // namespace refield
