// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/gui/file_dialog.h"

#include <imgui.h>

#include <algorithm>
#include <optional>
#include <string>

#include "relight/viewer/gui/drawing.h"
#include "relight/viewer/gui/widgets.h"

namespace refield {

namespace fs = std::filesystem;

namespace {

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
