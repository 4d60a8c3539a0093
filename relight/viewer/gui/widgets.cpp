// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/gui/widgets.h"

#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "relight/viewer/gui/drawing.h"

namespace refield {

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

bool button(WindowState& window, const char* name, bool is_on) {
  if (is_on) {
    ImGui::PushStyleColor(ImGuiCol_Button, accent_colour);
    ImGui::PushStyleColor(ImGuiCol_ButtonHovered, accent_colour);
    ImGui::PushStyleColor(ImGuiCol_Text, 0xff101010);
  }
  const bool is_pressed = ImGui::Button(name);
  if (is_on) ImGui::PopStyleColor(3);
  note_control(window, name);
  return is_pressed;
}

void note_control(WindowState& window, const std::string& name) {
  const ImVec2 low = ImGui::GetItemRectMin(), high = ImGui::GetItemRectMax();
  const Point middle{0.5 * (low.x + high.x), 0.5 * (low.y + high.y)};
  // At least half of it, so that the middle can be clicked.
  const bool is_visible = ImGui::IsRectVisible(vector(middle.x - 1.0, middle.y - 1.0), vector(middle));
  window.controls[name] = {middle, is_visible};
}

bool stops_slider(const char* name, const char* id, double& factor, float low, float high) {
  label(name);
  auto stops = static_cast<float>(std::log2(std::max(factor, 1e-9)));
  if (!ImGui::SliderFloat(id, &stops, low, high, "%+.2f stops")) return false;
  factor = std::exp2(stops);
  return true;
}

bool tone_controls(WindowState& window, ToneMapping& tone) {
  bool is_changed = stops_slider("Exposure", "##exposure", tone.exposure, -20.0f, 20.0f);
  label("Tone curve");
  for (const ToneOperator each : tone_operators) {
    const std::string name(name_of(each));
    if (button(window, name.c_str(), tone.curve == each)) {
      tone.curve = each;
      is_changed = true;
    }
    ImGui::SameLine();
  }
  ImGui::NewLine();
  return is_changed;
}

void window_buttons(WindowState& window, const std::string& stem) {
  if (button(window, "Save")) ask_where_to_save(window, stem);
  ImGui::SameLine();
  if (button(window, "Screenshot")) window.wants_screenshot = true;
  ImGui::SameLine();
  if (button(window, "Help", window.shows_help)) window.shows_help = !window.shows_help;
}

}  // namespace refield
