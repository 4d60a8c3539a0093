// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/window_panels.h"

#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "relight/viewer/drawing.h"

namespace refield {

namespace {

std::string time_text(const WindowState& window) {
  const FrameStatistics recent = frame_statistics({window.recent_frames.begin(), window.recent_frames.end()});
  if (recent.frames == 0) return "";
  char text[160], view[40] = "";
  if (recent.mean.view_ms > 0.0) std::snprintf(view, sizeof view, "view %.1f ms · ", recent.mean.view_ms);
  std::snprintf(text, sizeof text, "relighting %.1f ms · %stone %.1f ms · drawing %.1f ms · %.0f frames/s",
                recent.mean.relight_ms, view, recent.mean.tone_ms, recent.mean.draw_ms, recent.per_second);
  return text;
}

void help_column(const std::vector<ShortcutKey>& all, std::size_t first, std::size_t last) {
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

std::string pointer_text(const Canvas& canvas, const Image& image, const char* what) {
  const ImVec2 mouse = ImGui::GetIO().MousePos;
  const Point p = canvas.image_from_window({mouse.x, mouse.y});
  const int x = static_cast<int>(std::floor(p.x)), y = static_cast<int>(std::floor(p.y));
  if (!canvas.area().holds(mouse.x, mouse.y) || x < 0 || y < 0 || x >= image.width || y >= image.height)
    return "";
  char text[120];
  std::snprintf(text, sizeof text, "%s %d, %d:  %.4g  %.4g  %.4g", what, x, y, image.at(x, y, 0),
                image.at(x, y, 1), image.at(x, y, 2));
  return text;
}

void draw_status_bar(const WindowState& window, const Area& area, const std::string& name,
                     const std::string& pointer) {
  ImDrawList& list = *ImGui::GetBackgroundDrawList();
  const double top = area.y + 0.5 * (area.height - ImGui::GetTextLineHeight());
  const std::string time = time_text(window);
  list.AddText(vector(area.x + 14.0, top), text_colour, name.c_str());
  list.AddText(vector(area.x + 0.27 * area.width, top), 0xff909090, pointer.c_str());
  list.AddText(vector(area.x + area.width - 14.0 - ImGui::CalcTextSize(time.c_str()).x, top), 0xff909090,
               time.c_str());
}

void draw_notice(WindowState& window, const Area& area) {
  if (!window.notice) return;
  if (std::chrono::steady_clock::now() > window.notice->until) {
    window.notice.reset();
    return;
  }
  const double width = std::min(620.0, area.width - 40.0);
  ImGui::SetNextWindowPos(vector(area.x + 0.5 * area.width, area.y + 20.0), 0, ImVec2(0.5f, 0.0f));
  ImGui::SetNextWindowSizeConstraints(ImVec2(0, 0), vector(width, area.height));
  ImGui::PushStyleColor(ImGuiCol_WindowBg, window.notice->is_error ? 0xf0202a60 : 0xf0303030);
  ImGui::Begin("##notice", nullptr,
               ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoInputs | ImGuiWindowFlags_AlwaysAutoResize |
                   ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_NoNav |
                   ImGuiWindowFlags_NoFocusOnAppearing);
  const float wanted = ImGui::CalcTextSize(window.notice->text.c_str()).x;
  ImGui::PushTextWrapPos(std::min(wanted + 14.0f, static_cast<float>(width) - 24.0f));
  ImGui::TextUnformatted(window.notice->text.c_str());
  ImGui::PopTextWrapPos();
  ImGui::End();
  ImGui::PopStyleColor();
}

void draw_help(WindowState& window, const Area& area, const char* mouse, const std::vector<ShortcutKey>& keys,
               const std::string& second_column) {
  const double width = std::min(760.0, area.width - 40.0);
  ImGui::SetNextWindowPos(vector(area.x + 0.5 * area.width, area.y + 0.5 * area.height), 0,
                          ImVec2(0.5f, 0.5f));
  ImGui::SetNextWindowSize(vector(width, 0.0));
  ImGui::SetNextWindowBgAlpha(0.97f);
  ImGui::Begin("##help", &window.shows_help,
               ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_NoMove |
                   ImGuiWindowFlags_NoNav | ImGuiWindowFlags_AlwaysAutoResize);
  ImGui::TextWrapped("%s", mouse);
  const auto half =
      static_cast<std::size_t>(std::ranges::find(keys, second_column, &ShortcutKey::group) - keys.begin());
  ImGui::Columns(2, "##shortcuts", false);
  help_column(keys, 0, half);
  ImGui::NextColumn();
  help_column(keys, half, keys.size());
  ImGui::Columns(1);
  ImGui::End();
}

}  // namespace refield
