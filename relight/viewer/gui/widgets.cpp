// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/gui/widgets.h"

#include <cmath>

#include "core/image/tone_map.h"

namespace refield {

namespace {

ImU32 packed(const EncodedColour& colour) {
  return ImGui::ColorConvertFloat4ToU32(ImVec4(colour[0], colour[1], colour[2], 1.0f));
}

}  // namespace

void begin_panel(const char* name, const Area& area, bool padded) {
  ImGui::SetNextWindowPos(vector(area.x, area.y));
  ImGui::SetNextWindowSize(vector(area.width, area.height));
  if (!padded) ImGui::PushStyleVar(ImGuiStyleVar_WindowPadding, ImVec2(0.0f, 0.0f));
  ImGui::Begin(name, nullptr,
               ImGuiWindowFlags_NoTitleBar | ImGuiWindowFlags_NoResize | ImGuiWindowFlags_NoMove |
                   ImGuiWindowFlags_NoCollapse | ImGuiWindowFlags_NoSavedSettings |
                   ImGuiWindowFlags_NoBringToFrontOnFocus | ImGuiWindowFlags_NoNav |
                   (padded ? 0
                           : ImGuiWindowFlags_NoScrollbar | ImGuiWindowFlags_NoScrollWithMouse |
                                 ImGuiWindowFlags_NoBackground));
  if (!padded) ImGui::PopStyleVar();
}

void end_panel() {
  ImGui::End();
}

void begin_canvas(const char* name, const Area& area) {
  begin_panel(name, area, false);
  ImGui::InvisibleButton("##canvas", ImGui::GetContentRegionAvail(),
                         ImGuiButtonFlags_MouseButtonLeft | ImGuiButtonFlags_MouseButtonRight |
                             ImGuiButtonFlags_MouseButtonMiddle);
  ImGui::GetWindowDrawList()->AddRectFilled(
      vector(area.x, area.y), vector(area.x + area.width, area.y + area.height), canvas_colour, 6.0f);
}

void draw_ring(const Point& middle, double radius) {
  constexpr int smooth = 32;
  ImDrawList& list = *ImGui::GetWindowDrawList();
  list.AddCircle(vector(middle), static_cast<float>(radius), shadow_colour, smooth, 4.0f);
  list.AddCircle(vector(middle), static_cast<float>(radius), accent_colour, smooth, 2.0f);
}

double draw_plate(const Point& corner, const char* text, PackedColour colour) {
  constexpr float margin_x = 8.0f, margin_y = 4.0f;
  const ImVec2 at = vector(corner.x, corner.y), size = ImGui::CalcTextSize(text);
  ImDrawList& list = *ImGui::GetWindowDrawList();
  list.AddRectFilled(at, ImVec2(at.x + size.x + 2 * margin_x, at.y + size.y + 2 * margin_y), shadow_colour,
                     4.0f);
  list.AddText(ImVec2(at.x + margin_x, at.y + margin_y), colour, text);
  return size.x + 2 * margin_x;
}

void draw_legend(const Area& area, const char* low, const char* high) {
  ImDrawList& list = *ImGui::GetWindowDrawList();
  constexpr double margin = 10.0, bar_height = 10.0;
  list.AddRectFilled(vector(area.x, area.y), vector(area.x + area.width, area.y + area.height), shadow_colour,
                     4.0f);
  const double left = area.x + margin, right = area.x + area.width - margin, top = area.y + margin;
  const double step = (right - left) / (false_colour_stops.size() - 1);
  for (std::size_t i = 0; i + 1 < false_colour_stops.size(); ++i) {
    const ImU32 from = packed(false_colour_stops[i]), to = packed(false_colour_stops[i + 1]);
    const double x = left + static_cast<double>(i) * step;
    list.AddRectFilledMultiColor(vector(x, top), vector(x + step, top + bar_height), from, to, to, from);
  }
  const double text_top = top + bar_height + 4.0;
  list.AddText(vector(left, text_top), text_colour, low);
  list.AddText(vector(right - ImGui::CalcTextSize(high).x, text_top), text_colour, high);
}

void heading(const char* text) {
  ImGui::Dummy(ImVec2(0.0f, 2.0f));
  ImGui::TextColored(ImGui::ColorConvertU32ToFloat4(accent_colour), "%s", text);
  ImGui::Separator();
}

void label(const char* text) {
  constexpr float label_width = 108.0f;
  ImGui::AlignTextToFramePadding();
  ImGui::TextUnformatted(text);
  ImGui::SameLine(label_width);
  ImGui::SetNextItemWidth(-1.0f);
}

bool button(const char* name, bool is_on) {
  if (is_on) {
    ImGui::PushStyleColor(ImGuiCol_Button, accent_colour);
    ImGui::PushStyleColor(ImGuiCol_ButtonHovered, accent_colour);
    ImGui::PushStyleColor(ImGuiCol_Text, 0xff101010);
  }
  const bool is_pressed = ImGui::Button(name);
  if (is_on) ImGui::PopStyleColor(3);
  return is_pressed;
}

bool stops_slider(const char* name, const char* id, double& factor, float low, float high) {
  label(name);
  auto stops = static_cast<float>(std::log2(std::max(factor, 1e-9)));
  if (!ImGui::SliderFloat(id, &stops, low, high, "%+.2f stops")) return false;
  factor = std::exp2(stops);
  return true;
}

}  // namespace refield
