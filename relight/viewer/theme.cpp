// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/theme.h"

#include <imgui.h>

#include <filesystem>

namespace refield {

namespace {

constexpr float font_size_px = 15.0f;

ImVec4 grey(float value, float alpha = 1.0f) {
  return {value, value, value, alpha};
}

/// The desktop's usual fonts; without them Dear ImGui's own, which has no signs beyond ASCII.
void load_font(float scale) {
  ImGuiIO& io = ImGui::GetIO();
  static const ImWchar signs[] = {0x20,   0xff,   0x2010, 0x2044, 0x2070, 0x207f, 0x2150,
                                  0x215e, 0x2190, 0x2193, 0x2211, 0x2265, 0};
  for (const char* file :
       {"/usr/share/fonts/truetype/dejavu/DejaVuSans.ttf",
        "/usr/share/fonts/dejavu-sans-fonts/DejaVuSans.ttf", "/usr/share/fonts/TTF/DejaVuSans.ttf",
        "/usr/share/fonts/truetype/liberation/LiberationSans-Regular.ttf"})
    if (std::filesystem::exists(file) &&
        io.Fonts->AddFontFromFileTTF(file, font_size_px * scale, nullptr, signs) != nullptr)
      return;
  io.FontGlobalScale = scale;
}

}  // namespace

WindowColour background_colour() {
  return {0.085f, 0.085f, 0.09f};
}

void apply_theme(float scale) {
  load_font(scale);
  ImGui::StyleColorsDark();
  ImGuiStyle& style = ImGui::GetStyle();
  style.WindowRounding = 6.0f;
  style.ChildRounding = 6.0f;
  style.FrameRounding = 4.0f;
  style.GrabRounding = 4.0f;
  style.PopupRounding = 6.0f;
  style.ScrollbarRounding = 6.0f;
  style.ScrollbarSize = 11.0f;
  style.WindowBorderSize = 0.0f;
  style.FramePadding = ImVec2(8.0f, 4.0f);
  style.ItemSpacing = ImVec2(8.0f, 6.0f);
  style.WindowPadding = ImVec2(12.0f, 10.0f);
  style.GrabMinSize = 12.0f;
  style.ScaleAllSizes(scale);

  const ImVec4 accent(0.94f, 0.64f, 0.24f, 1.0f), soft_accent(0.94f, 0.64f, 0.24f, 0.35f);
  ImVec4* colours = style.Colors;
  colours[ImGuiCol_Text] = grey(0.86f);
  colours[ImGuiCol_TextDisabled] = grey(0.52f);
  colours[ImGuiCol_WindowBg] = grey(0.135f);
  colours[ImGuiCol_ChildBg] = grey(0.0f, 0.0f);
  colours[ImGuiCol_PopupBg] = grey(0.12f, 0.97f);
  colours[ImGuiCol_Border] = grey(0.26f);
  colours[ImGuiCol_FrameBg] = grey(0.20f);
  colours[ImGuiCol_FrameBgHovered] = grey(0.25f);
  colours[ImGuiCol_FrameBgActive] = grey(0.28f);
  colours[ImGuiCol_ScrollbarBg] = grey(0.0f, 0.0f);
  colours[ImGuiCol_ScrollbarGrab] = grey(0.30f);
  colours[ImGuiCol_CheckMark] = accent;
  colours[ImGuiCol_SliderGrab] = grey(0.40f);
  colours[ImGuiCol_SliderGrabActive] = ImVec4(0.72f, 0.46f, 0.14f, 1.0f);
  colours[ImGuiCol_Button] = grey(0.22f);
  colours[ImGuiCol_ButtonHovered] = grey(0.29f);
  colours[ImGuiCol_ButtonActive] = soft_accent;
  colours[ImGuiCol_Header] = grey(0.20f);
  colours[ImGuiCol_HeaderHovered] = grey(0.26f);
  colours[ImGuiCol_HeaderActive] = soft_accent;
  colours[ImGuiCol_Separator] = grey(0.24f);
  colours[ImGuiCol_TableHeaderBg] = grey(0.17f);
  colours[ImGuiCol_TableRowBgAlt] = grey(1.0f, 0.02f);
}

}  // namespace refield
