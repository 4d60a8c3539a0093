// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/gui/window_panels.h"

#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>
#include <string>

#include "relight/viewer/gui/widgets.h"

namespace refield {

namespace fs = std::filesystem;

namespace {

std::string time_text(const WindowState& window) {
  const FrameStatistics recent = frame_statistics({window.recent_frames.begin(), window.recent_frames.end()});
  if (recent.frames == 0) return "";
  char text[200], view[40] = "", light[40] = "";
  if (recent.mean.view_ms > 0.0) std::snprintf(view, sizeof view, "view %.1f ms · ", recent.mean.view_ms);
  if (recent.mean.light_ms > 0.0)
    std::snprintf(light, sizeof light, "light map %.1f ms · ", recent.mean.light_ms);
  std::snprintf(text, sizeof text, "%srelighting %.1f ms · %sdrawing %.1f ms · %.0f frames/s", light,
                recent.mean.relight_ms, view, recent.mean.tone_ms + recent.mean.draw_ms, recent.per_second);
  return text;
}

/// A key, below its group's name where the group begins; the number of lines.
std::size_t help_line(const ShortcutKey& key, bool begins_group) {
  constexpr float key_width = 90.0f;
  if (begins_group)
    ImGui::TextColored(ImGui::ColorConvertU32ToFloat4(accent_colour), "%s", key.group.c_str());
  ImGui::TextUnformatted(key.name.c_str());
  ImGui::SameLine(key_width);  // from the column's left edge
  ImGui::TextDisabled("%s", key.help.c_str());
  return begins_group ? 2 : 1;
}

constexpr std::size_t shown_recent = 5;

/// A line that can be clicked, and found by scripts under its text.
bool line(WindowState& window, const std::string& text, const std::string& id) {
  const bool is_clicked = ImGui::Selectable((text + "##" + id).c_str());
  note_control(window, text);
  return is_clicked;
}

/// Goes to a folder, or takes a file.
std::optional<fs::path> follow(FileDialog& dialog, const fs::path& path) {
  std::error_code error;
  if (!fs::is_directory(path, error)) return path;
  dialog.go_to(path);
  return std::nullopt;
}

std::optional<fs::path> typed_path(FileDialog& dialog) {
  const fs::path typed = dialog.typed.data();
  return typed.empty() ? std::nullopt : follow(dialog, dialog.folder / typed);  // absolute ones stay
}

std::optional<fs::path> draw_recent(WindowState& window, FileDialog& dialog,
                                    std::span<const fs::path> recent) {
  std::optional<fs::path> chosen;
  if (recent.empty()) return chosen;
  ImGui::TextDisabled("Recent files");
  for (std::size_t i = 0; i < std::min(recent.size(), shown_recent); ++i)
    if (line(window, recent[i].string(), "recent")) chosen = follow(dialog, recent[i]);
  ImGui::Separator();
  return chosen;
}

std::optional<fs::path> draw_folder(WindowState& window, FileDialog& dialog, double height) {
  std::optional<fs::path> chosen;
  ImGui::TextDisabled("%s", dialog.folder.c_str());
  ImGui::BeginChild("##folder", vector(0.0, height), true);
  fs::path entered;
  if (dialog.folder.has_relative_path() && line(window, "..", "up")) entered = dialog.folder.parent_path();
  for (const fs::path& folder : dialog.folders)
    if (line(window, folder.filename().string() + "/", "folder")) entered = folder;
  for (const fs::path& file : dialog.files)
    if (line(window, file.filename().string(), "file")) {
      chosen = file;
      dialog.type(file.filename().string());
    }
  if (dialog.files.empty()) ImGui::TextDisabled("%s", "no such files here");
  ImGui::EndChild();
  if (!entered.empty()) dialog.go_to(entered);
  return chosen;
}

}  // namespace

std::string pointer_text(const Canvas& canvas, const Image& image, const char* what,
                         const std::optional<PixelGrid>& grid) {
  const ImVec2 mouse = ImGui::GetIO().MousePos;
  const Point p = canvas.image_from_window({mouse.x, mouse.y});
  const PixelGrid held = grid.value_or(PixelGrid{{0, 0, image.width, image.height}, 1});
  const auto at = held.position_of({static_cast<int>(std::floor(p.x)), static_cast<int>(std::floor(p.y))});
  if (!canvas.area().holds(mouse.x, mouse.y) || !at) return "";
  char text[120];
  std::snprintf(text, sizeof text, "%s %d, %d:  %.4g  %.4g  %.4g", what, held.x_of(at->x), held.y_of(at->y),
                image.at(at->x, at->y, 0), image.at(at->x, at->y, 1), image.at(at->x, at->y, 2));
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

Area above_help(const WindowState& window, const Area& area) {
  constexpr double gap = 8.0, least = 120.0;
  return {area.x, area.y, area.width, std::max(area.height - window.help_height - gap, least)};
}

void draw_help(WindowState& window, const Area& area, const char* mouse,
               const std::vector<ShortcutKey>& keys) {
  constexpr double column_width = 290.0;
  const auto columns = static_cast<std::size_t>(std::clamp(std::floor(area.width / column_width), 1.0, 4.0));
  ImGui::SetNextWindowPos(vector(area.x, area.y + area.height), 0, ImVec2(0.0f, 1.0f));
  ImGui::SetNextWindowSizeConstraints(vector(area.width, 0.0), vector(area.width, 0.75 * area.height));
  ImGui::Begin("##help", nullptr,
               ImGuiWindowFlags_NoTitleBar | ImGuiWindowFlags_NoResize | ImGuiWindowFlags_NoSavedSettings |
                   ImGuiWindowFlags_NoMove | ImGuiWindowFlags_NoNav | ImGuiWindowFlags_AlwaysAutoResize);
  ImGui::PushTextWrapPos(static_cast<float>(area.width) - 16.0f);
  ImGui::TextUnformatted(mouse);
  ImGui::PopTextWrapPos();
  std::size_t groups = 1;
  for (std::size_t i = 1; i < keys.size(); ++i) groups += keys[i].group != keys[i - 1].group;
  const std::size_t lines = (keys.size() + groups + columns - 1) / columns;
  ImGui::Columns(static_cast<int>(columns), "##shortcuts", false);
  std::size_t line = 0;
  for (std::size_t i = 0; i < keys.size(); ++i) {
    const bool begins = i == 0 || keys[i].group != keys[i - 1].group;
    // A heading stays with its first key.
    if (line + begins >= lines && line > 0) {
      ImGui::NextColumn();
      line = 0;
    }
    line += help_line(keys[i], begins);
  }
  ImGui::Columns(1);
  window.help_height = ImGui::GetWindowHeight();
  ImGui::End();
}

void draw_file_dialog(WindowState& window, const Area& area, std::span<const fs::path> recent,
                      const std::function<void(const fs::path&)>& take) {
  if (!window.dialog) return;
  FileDialog& dialog = *window.dialog;
  const bool opens = dialog.purpose == FileDialog::Purpose::open;
  const double width = std::min(640.0, area.width - 24.0);
  ImGui::SetNextWindowPos(vector(area.x + 0.5 * area.width, area.y + 40.0), 0, ImVec2(0.5f, 0.0f));
  ImGui::SetNextWindowSize(vector(width, 0.0));
  ImGui::SetNextWindowBgAlpha(1.0f);
  if (dialog.is_new) ImGui::SetNextWindowFocus();
  ImGui::Begin("##dialog", nullptr,
               ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_NoMove |
                   ImGuiWindowFlags_NoNav | ImGuiWindowFlags_AlwaysAutoResize);
  heading(opens ? "OPEN A LIGHT MAP OR A FIELD" : "SAVE THE PICTURE");
  if (!opens) ImGui::TextDisabled("%s", ".exr: scene-linear; .png: as shown");
  if (dialog.is_new) ImGui::SetKeyboardFocusHere();
  dialog.is_new = false;
  ImGui::SetNextItemWidth(-1.0f);
  std::optional<fs::path> chosen;
  if (ImGui::InputTextWithHint("##path", "Name or path, then Enter", dialog.typed.data(), dialog.typed.size(),
                               ImGuiInputTextFlags_EnterReturnsTrue | ImGuiInputTextFlags_AutoSelectAll))
    chosen = typed_path(dialog);
  if (opens)
    if (const auto old = draw_recent(window, dialog, recent)) chosen = old;
  const auto in_folder = draw_folder(window, dialog, std::clamp(area.height - 360.0, 90.0, 260.0));
  if (opens && in_folder) chosen = in_folder;  // a click opens; saving over a file takes one more
  if (button(window, opens ? "Open file" : "Save file")) chosen = typed_path(dialog);
  ImGui::SameLine();
  const bool is_left = button(window, "Cancel");
  ImGui::End();
  if (!chosen && !is_left) return;
  if (chosen) take(*chosen);
  window.dialog.reset();
}

}  // namespace refield
