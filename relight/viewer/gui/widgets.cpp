// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/gui/widgets.h"

#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>

#include "core/base/number_text.h"
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

void fill_area(const Area& area, Canvas& canvas, FreeView& view) {
  canvas.fit();
  const int width = std::max(1, static_cast<int>(area.width)),
            height = std::max(1, static_cast<int>(area.height));
  if (view.camera().width != width || view.camera().height != height) view.move().set_size(width, height);
}

void begin_picture_panel(const Area& area, Canvas& canvas, int picture_width, int picture_height) {
  canvas.lay_out(area, picture_width, picture_height);
  begin_panel("##picture", area, false);
  ImGui::InvisibleButton("##canvas", ImGui::GetContentRegionAvail(),
                         ImGuiButtonFlags_MouseButtonLeft | ImGuiButtonFlags_MouseButtonRight |
                             ImGuiButtonFlags_MouseButtonMiddle);
}

void draw_picture(const Canvas& canvas, const PixelGrid& pixels, const Texture& texture) {
  const Area& area = canvas.area();
  ImDrawList& list = *ImGui::GetWindowDrawList();
  list.AddRectFilled(vector(area.x, area.y), vector(area.x + area.width, area.y + area.height), canvas_colour,
                     6.0f);
  const auto corner = [&](int x, int y) {
    return vector(canvas.window_from_image({static_cast<double>(x), static_cast<double>(y)}));
  };
  list.PushClipRect(corner(pixels.region.x0, pixels.region.y0), corner(pixels.region.x1, pixels.region.y1),
                    true);
  list.AddImage(texture.handle(), corner(pixels.x_of(0), pixels.y_of(0)),
                corner(pixels.x_of(pixels.width()), pixels.y_of(pixels.height())));
  list.PopClipRect();
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

bool tone_controls(ToneMapping& tone) {
  bool is_changed = stops_slider("Exposure", "##exposure", tone.exposure, -20.0f, 20.0f);
  label("Tone curve");
  for (const ToneOperator each : tone_operators) {
    const std::string name(name_of(each));
    if (button(name.c_str(), tone.curve == each)) {
      tone.curve = each;
      is_changed = true;
    }
    ImGui::SameLine();
  }
  ImGui::NewLine();
  return is_changed;
}

void window_buttons(WindowState& window, const std::string& stem) {
  if (button("Save")) ask_where_to_save(window, stem);
  ImGui::SameLine();
  if (button("Screenshot")) window.wants_screenshot = true;
  ImGui::SameLine();
  if (button("Help", window.shows_help)) window.shows_help = !window.shows_help;
}

namespace fs = std::filesystem;

namespace {

/// Means over the recent frames; of the light map and relighting over those that relit.
std::string time_text(const WindowState& window) {
  if (window.recent_frames.empty()) return "";
  FrameTime sum;
  double relit = 0.0;
  for (const FrameTime& frame : window.recent_frames) {
    sum.total_ms += frame.total_ms;
    sum.relight_ms += frame.relight_ms;
    sum.light_ms += frame.light_ms;
    sum.view_ms += frame.view_ms;
    sum.draw_ms += frame.tone_ms + frame.draw_ms;
    relit += frame.relight_ms > 0.0 ? 1.0 : 0.0;
  }
  const auto frames = static_cast<double>(window.recent_frames.size());
  relit = std::max(relit, 1.0);
  const std::string light = sum.light_ms > 0.0 ? formatted("light map %.1f ms · ", sum.light_ms / relit) : "",
                    view = sum.view_ms > 0.0 ? formatted("view %.1f ms · ", sum.view_ms / frames) : "";
  return light + formatted("relighting %.1f ms · ", sum.relight_ms / relit) + view +
         formatted("drawing %.1f ms · %.0f frames/s", sum.draw_ms / frames,
                   sum.total_ms > 0.0 ? 1000.0 * frames / sum.total_ms : 0.0);
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

/// A line that can be clicked.
bool line(const std::string& text, const std::string& id) {
  return ImGui::Selectable((text + "##" + id).c_str());
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

std::optional<fs::path> draw_folder(FileDialog& dialog, double height) {
  std::optional<fs::path> chosen;
  ImGui::TextDisabled("%s", dialog.folder.c_str());
  ImGui::BeginChild("##folder", vector(0.0, height), true);
  fs::path entered;
  if (dialog.folder.has_relative_path() && line("..", "up")) entered = dialog.folder.parent_path();
  for (const fs::path& folder : dialog.folders)
    if (line(folder.filename().string() + "/", "folder")) entered = folder;
  for (const fs::path& file : dialog.files)
    if (line(file.filename().string(), "file")) {
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
  return formatted("%s %d, %d:  %.4g  %.4g  %.4g", what, held.x_of(at->x), held.y_of(at->y),
                   image.at(at->x, at->y, 0), image.at(at->x, at->y, 1), image.at(at->x, at->y, 2));
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

void draw_file_dialog(WindowState& window, const Area& area,
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
  const auto in_folder = draw_folder(dialog, std::clamp(area.height - 360.0, 90.0, 260.0));
  if (opens && in_folder) chosen = in_folder;  // a click opens; saving over a file takes one more
  if (button(opens ? "Open file" : "Save file")) chosen = typed_path(dialog);
  ImGui::SameLine();
  const bool is_left = button("Cancel");
  ImGui::End();
  if (!chosen && !is_left) return;
  try {
    if (chosen) take(*chosen);
  } catch (const Error& error) {
    complain(window, error.what());
  }
  window.dialog.reset();
}

}  // namespace refield
