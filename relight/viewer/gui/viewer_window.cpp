// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/gui/viewer_window.h"

#define GLFW_INCLUDE_NONE

#include <GLFW/glfw3.h>

#include <cmath>

#include "core/base/number_text.h"
#include "core/image/image_io.h"
#include "relight/viewer/gui/background_job.h"
#include "relight/viewer/gui/widgets.h"

namespace refield {

namespace {

using Clock = std::chrono::steady_clock;

constexpr std::array<std::string_view, 8> opened_extensions = {".rfield", ".exr",  ".hdr", ".png",
                                                               ".jpg",    ".jpeg", ".tif", ".tiff"};

constexpr double status_height = 30.0;
constexpr double idle_patience_s = 0.2;
/// Panels settle their layout over a few frames after the last event.
constexpr int frames_after_event = 4;
constexpr std::size_t max_recent_frames = 30;
constexpr double third_of_a_stop = 1.0 / 3.0;

double milliseconds_between(Clock::time_point from, Clock::time_point to) {
  return std::chrono::duration<double, std::milli>(to - from).count();
}

/// A name in the working folder that no file has yet: "view-0001.png".
fs::path free_name(const std::string& stem, const std::string& extension) {
  for (int i = 1;; ++i) {
    fs::path name = stem + formatted("-%04d", i) + extension;
    if (!fs::exists(name)) return name;
  }
}

Point mouse() {
  return {ImGui::GetIO().MousePos.x, ImGui::GetIO().MousePos.y};
}

PixelPosition pixel_at(const Canvas& canvas, const Point& window) {
  const Point p = canvas.image_from_window(window);
  return {static_cast<int>(std::floor(p.x)), static_cast<int>(std::floor(p.y))};
}

}  // namespace

FileDialog::FileDialog(Purpose wanted, const fs::path& start) : purpose(wanted) {
  go_to(start);
}

void FileDialog::go_to(const fs::path& wanted) {
  std::error_code error;
  folder = fs::absolute(wanted.empty() ? "." : wanted, error).lexically_normal();
  if (!folder.has_filename() && folder.has_relative_path()) folder = folder.parent_path();  // "a/"
  folders.clear();
  files.clear();
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    const fs::path& path = entry->path();
    if (path.filename().string().starts_with('.')) continue;
    std::error_code unknown;
    if (entry->is_directory(unknown))
      folders.push_back(path);
    else if (std::ranges::find(opened_extensions, path.extension().string()) != opened_extensions.end())
      files.push_back(path);
  }
  std::ranges::sort(folders);
  std::ranges::sort(files);
  if (purpose == Purpose::open) type("");
}

void FileDialog::type(const std::string& text) {
  typed.fill('\0');
  std::copy_n(text.begin(), std::min(text.size(), typed.size() - 1), typed.begin());
}

void ViewerWindow::notify(const std::string& text, bool is_error, std::chrono::seconds duration) {
  run.note(text);
  notice_ = Notice{text, is_error, Clock::now() + duration};
}

void ViewerWindow::attempt(const std::function<void()>& work) {
  try {
    work();
  } catch (const Error& error) {
    complain(error.what());
  }
}

void ViewerWindow::write_picture(const fs::path& file, const ToneMapping& mapping, ColourSpace space) {
  if (file.extension() == ".exr")
    write_exr(file, radiance(), Precision::single, space);
  else if (file.extension() == ".png")
    write_png(file, radiance(), mapping);
  else
    throw InputError(file, ": pictures are saved as .exr (scene-linear) or .png");
  say("Saved " + file.string());
}

void ViewerWindow::save_both() {
  attempt([&] {
    const fs::path file = free_name(stem_, ".exr");
    save(file);
    save(fs::path(file).replace_extension(".png"));
  });
}

void ViewerWindow::leave() {
  if (dialog)
    dialog.reset();
  else if (shows_help_)
    shows_help_ = false;
  else
    deselect();
}

std::vector<Shortcut> ViewerWindow::all_shortcuts() {
  const std::string picture = "Image", rest = "General";
  const auto expose_by = [this](double stops) {
    set_tone({tone().exposure * std::exp2(stops), tone().curve});
  };
  std::vector<Shortcut> keys = shortcuts();
  const std::vector<Shortcut> common = {
      {picture, "E", GLFW_KEY_E, false, "brighter by ⅓ stop", [=] { expose_by(third_of_a_stop); }},
      {picture, "D", GLFW_KEY_D, false, "darker by ⅓ stop", [=] { expose_by(-third_of_a_stop); }},
      {picture, "T", GLFW_KEY_T, false, "next tone curve",
       [this] {
         set_tone({tone().exposure, next(tone().curve)});
       }},
      {picture, "F", GLFW_KEY_F, false, "fit; reset camera",
       [this] {
         if (FreeView* view = camera()) view->move().reset();
         canvas.fit();
       }},
      {rest, "S", GLFW_KEY_S, false, "screenshot, view-0001.png", [this] { wants_screenshot_ = true; }},
      {rest, "W", GLFW_KEY_W, false, "save as " + stem_ + "-0001.exr and .png", [this] { save_both(); }},
      {rest, "F1", GLFW_KEY_F1, false, "this help", [this] { shows_help_ = !shows_help_; }},
      {rest, "Escape", GLFW_KEY_ESCAPE, false, "close, deselect", [this] { leave(); }},
      {rest, "Shift+Q", GLFW_KEY_Q, true, "quit", [this] { wants_to_close_ = true; }},
  };
  keys.insert(keys.end(), common.begin(), common.end());
  return keys;
}

void ViewerWindow::handle(const FrameInput& input) {
  for (const fs::path& file : input.dropped) open(file);
  if (ImGui::GetIO().WantTextInput) return;
  for (const PressedKey& pressed : input.keys) {
    const auto shortcut = std::ranges::find_if(keys_, [&](const Shortcut& one) {
      return one.key == pressed.key && one.with_shift == pressed.with_shift;
    });
    if (shortcut != keys_.end()) shortcut->action();
  }
}

/// Waits a little where nothing happens.
bool ViewerWindow::is_frame_due(GlWindow& window) {
  const bool is_due = is_busy() || (camera() && camera()->wants_rest()) || frames_left_ > 0 || is_playing;
  const bool has_input = window.collect(is_due ? 0.0 : idle_patience_s);
  if (has_input) frames_left_ = frames_after_event;
  return is_due || has_input || (notice_ && Clock::now() > notice_->until);
}

void ViewerWindow::show_in(GlWindow& window) {
  keys_ = all_shortcuts();
  frames_left_ = frames_after_event;
  Texture texture;
  std::string titled;
  while (!window.is_closed() && !wants_to_close_) {
    run.throw_if_stopped();
    if (!is_frame_due(window)) {
      last_end_.reset();
      last_moved_.reset();
      continue;
    }
    --frames_left_;
    const auto start = Clock::now();
    if (is_playing && last_moved_) advance(milliseconds_between(*last_moved_, start) / 1000.0);
    last_moved_ = start;
    handle(window.begin_frame());
    const FrameTime parts = draw(texture);
    if (!end_frame(window)) note_time(start, parts);
    if (const std::string now = title(); titled != now) window.set_title((titled = now) + " – refield");
  }
}

void ViewerWindow::note_time(Clock::time_point start, FrameTime time) {
  const auto end = Clock::now();
  time.total_ms = milliseconds_between(last_end_.value_or(start), end);
  time.draw_ms = milliseconds_between(start, end) - time.wait_ms - time.view_ms - time.tone_ms;
  last_end_ = end;
  recent_frames_.push_back(time);
  if (recent_frames_.size() > max_recent_frames) recent_frames_.pop_front();
}

/// Whether a screenshot was taken, too, which makes the frame long.
bool ViewerWindow::end_frame(GlWindow& window) {
  const bool is_asked_for = std::exchange(wants_screenshot_, false);
  ScreenImage shot;
  window.end_frame(is_asked_for ? &shot : nullptr);
  if (!is_asked_for) return false;
  const fs::path file = free_name("view", ".png");
  write_png(file, shot);
  last_end_.reset();  // the time that writing took is no frame's
  say("Saved " + file.string());
  return true;
}

FrameTime ViewerWindow::draw(Texture& texture) {
  constexpr double least_height = 120.0;
  const ImVec2 window = ImGui::GetIO().DisplaySize;
  const double side = std::clamp(0.32 * window.x, min_side, max_side);
  const Area left{panel_gap, panel_gap, window.x - side - 3.0 * panel_gap,
                  window.y - 2.0 * panel_gap - status_height};
  Area picture = left;
  if (shows_help_) picture.height = std::max(left.height - help_height_ - panel_gap, least_height);
  draw_controls({left.width + 2.0 * panel_gap, panel_gap, side, left.height});
  const Refreshed done = draw_picture(picture, texture);
  draw_status_bar({0.0, window.y - status_height, window.x, status_height});
  draw_notice(picture);
  if (shows_help_) draw_help(left);
  if (dialog) draw_dialog(left);
  return done.time;
}

Refreshed ViewerWindow::draw_picture(const Area& area, Texture& texture) {
  if (FreeView* view = camera()) {
    // The camera's next picture is of the area's size, and stands in it unmoved.
    canvas.fit();
    const int width = std::max(1, static_cast<int>(area.width)),
              height = std::max(1, static_cast<int>(area.height));
    if (view->camera().width != width || view->camera().height != height)
      view->move().set_size(width, height);
  }
  canvas.lay_out(area, image_size().x, image_size().y);
  begin_canvas("##picture", area);
  handle_picture_mouse();
  Refreshed done;
  attempt([&] { done = refresh(); });
  if (done.picture) texture.update(radiance().width, radiance().height, levels());
  texture.set_smooth(is_smooth);
  const PixelGrid pixels = grid();
  const auto corner = [&](int x, int y) {
    return vector(canvas.window_from_image({static_cast<double>(x), static_cast<double>(y)}));
  };
  ImDrawList& list = *ImGui::GetWindowDrawList();
  list.PushClipRect(corner(pixels.region.x0, pixels.region.y0), corner(pixels.region.x1, pixels.region.y1),
                    true);
  list.AddImage(texture.handle(), corner(pixels.x_of(0), pixels.y_of(0)),
                corner(pixels.x_of(pixels.width()), pixels.y_of(pixels.height())));
  list.PopClipRect();
  draw_over_picture();
  end_panel();
  return done;
}

void ViewerWindow::handle_picture_mouse() {
  if (FreeView* view = camera()) return handle_camera_mouse(*view);
  const ImGuiIO& io = ImGui::GetIO();
  if (ImGui::IsItemHovered() && io.MouseWheel != 0.0f)
    canvas.zoom_about(mouse(), std::pow(1.2, io.MouseWheel));
  if (!ImGui::IsItemActive()) return;
  if (ImGui::IsMouseDown(ImGuiMouseButton_Left))
    pick(pixel_at(canvas, mouse()));
  else if (io.MouseDelta.x != 0.0f || io.MouseDelta.y != 0.0f)
    canvas.pan(io.MouseDelta.x, io.MouseDelta.y);
}

/// The left button drags what it holds, else turns the camera, and picks where it was not moved.
void ViewerWindow::handle_camera_mouse(FreeView& view) {
  constexpr float slack_px = 3.0f;
  constexpr double degrees_a_pixel = 0.35;
  const ImGuiIO& io = ImGui::GetIO();
  if (ImGui::IsItemHovered() && io.MouseWheel != 0.0f) view.move().approach(std::pow(1.15, io.MouseWheel));
  const bool is_left = ImGui::IsMouseDown(ImGuiMouseButton_Left);
  if (ImGui::IsItemActivated() && is_left) {
    pressed_ = mouse();
    is_held_ = take_hold(pixel_at(canvas, mouse()));
    is_dragging_ = false;
  }
  if (pressed_ && !is_left) {
    if (!is_dragging_ && ImGui::IsItemHovered()) pick(pixel_at(canvas, mouse()));
    pressed_.reset();
  }
  if (!ImGui::IsItemActive() || (io.MouseDelta.x == 0.0f && io.MouseDelta.y == 0.0f)) return;
  if (!pressed_) return view.move().pan(io.MouseDelta.x, io.MouseDelta.y);
  is_dragging_ = is_dragging_ || ImGui::IsMouseDragging(ImGuiMouseButton_Left, slack_px);
  if (!is_dragging_) return;
  const Point from = std::exchange(*pressed_, mouse());
  const double right = pressed_->x - from.x, down = pressed_->y - from.y;
  if (is_held_)
    drag_held(from, *pressed_, io.KeyShift);
  else if (io.KeyShift)
    view.move().pan(right, down);
  else
    view.move().orbit(-degrees_a_pixel * right, degrees_a_pixel * down);
}

void ViewerWindow::window_buttons() {
  if (button("Save")) {
    dialog.emplace(FileDialog::Purpose::save, ".");
    dialog->type(free_name(stem_, ".exr").string());
  }
  ImGui::SameLine();
  if (button("Screenshot")) wants_screenshot_ = true;
  ImGui::SameLine();
  if (button("Help", shows_help_)) shows_help_ = !shows_help_;
}

void ViewerWindow::tone_section() {
  ToneMapping mapping = tone();
  stops_slider("Exposure", "##exposure", mapping.exposure, -20.0f, 20.0f);
  label("Tone curve");
  for (const ToneOperator each : tone_operators) {
    const std::string name(name_of(each));
    if (button(name.c_str(), mapping.curve == each)) mapping.curve = each;
    ImGui::SameLine();
  }
  ImGui::NewLine();
  if (mapping != tone()) set_tone(mapping);
  if (button("Auto-expose")) expose();
  ImGui::SameLine();
  if (FreeView* view = camera()) {
    if (button("Reset camera")) view->move().reset();
    return;
  }
  if (button("Fit")) canvas.fit();
  ImGui::SameLine();
  if (button("1:1")) canvas.zoom_to(1.0);
  ImGui::SameLine();
  if (button("Smooth", is_smooth)) is_smooth = !is_smooth;
}

/// Means over the recent frames; of the light map and relighting over those that relit.
std::string ViewerWindow::time_text() const {
  if (recent_frames_.empty()) return "";
  FrameTime sum;
  double relit = 0.0;
  for (const FrameTime& frame : recent_frames_) {
    sum.total_ms += frame.total_ms;
    sum.relight_ms += frame.relight_ms;
    sum.light_ms += frame.light_ms;
    sum.view_ms += frame.view_ms;
    sum.draw_ms += frame.tone_ms + frame.draw_ms;
    relit += frame.relight_ms > 0.0 ? 1.0 : 0.0;
  }
  const auto frames = static_cast<double>(recent_frames_.size());
  relit = std::max(relit, 1.0);
  const std::string light = sum.light_ms > 0.0 ? formatted("light map %.1f ms · ", sum.light_ms / relit) : "",
                    view = sum.view_ms > 0.0 ? formatted("view %.1f ms · ", sum.view_ms / frames) : "";
  return light + formatted("relighting %.1f ms · ", sum.relight_ms / relit) + view +
         formatted("drawing %.1f ms · %.0f frames/s", sum.draw_ms / frames,
                   sum.total_ms > 0.0 ? 1000.0 * frames / sum.total_ms : 0.0);
}

namespace {

/// A key, below its group's name where the group begins; the number of lines.
std::size_t help_line(const Shortcut& key, bool begins_group) {
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

std::string pointer_text(const Canvas& canvas, const Image& image, const char* what, const PixelGrid& held) {
  const auto at = held.position_of(pixel_at(canvas, mouse()));
  if (!canvas.area().holds(mouse().x, mouse().y) || !at) return "";
  return formatted("%s %d, %d:  %.4g  %.4g  %.4g", what, held.x_of(at->x), held.y_of(at->y),
                   image.at(at->x, at->y, 0), image.at(at->x, at->y, 1), image.at(at->x, at->y, 2));
}

std::string ViewerWindow::pointer() const {
  return pointer_text(canvas, radiance(), "pixel", grid());
}

void ViewerWindow::draw_status_bar(const Area& area) const {
  ImDrawList& list = *ImGui::GetBackgroundDrawList();
  const double top = area.y + 0.5 * (area.height - ImGui::GetTextLineHeight());
  const std::string time = time_text();
  list.AddText(vector(area.x + 14.0, top), text_colour, name().c_str());
  list.AddText(vector(area.x + 0.27 * area.width, top), 0xff909090, pointer().c_str());
  list.AddText(vector(area.x + area.width - 14.0 - ImGui::CalcTextSize(time.c_str()).x, top), 0xff909090,
               time.c_str());
}

void ViewerWindow::draw_notice(const Area& area) {
  if (!notice_) return;
  if (std::chrono::steady_clock::now() > notice_->until) {
    notice_.reset();
    return;
  }
  const double width = std::min(620.0, area.width - 40.0);
  ImGui::SetNextWindowPos(vector(area.x + 0.5 * area.width, area.y + 20.0), 0, ImVec2(0.5f, 0.0f));
  ImGui::SetNextWindowSizeConstraints(ImVec2(0, 0), vector(width, area.height));
  ImGui::PushStyleColor(ImGuiCol_WindowBg, notice_->is_error ? 0xf0202a60 : 0xf0303030);
  ImGui::Begin("##notice", nullptr,
               ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoInputs | ImGuiWindowFlags_AlwaysAutoResize |
                   ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_NoNav |
                   ImGuiWindowFlags_NoFocusOnAppearing);
  const float wanted = ImGui::CalcTextSize(notice_->text.c_str()).x;
  ImGui::PushTextWrapPos(std::min(wanted + 14.0f, static_cast<float>(width) - 24.0f));
  ImGui::TextUnformatted(notice_->text.c_str());
  ImGui::PopTextWrapPos();
  ImGui::End();
  ImGui::PopStyleColor();
}

void ViewerWindow::draw_help(const Area& area) {
  constexpr double column_width = 290.0;
  const auto columns = static_cast<std::size_t>(std::clamp(std::floor(area.width / column_width), 1.0, 4.0));
  ImGui::SetNextWindowPos(vector(area.x, area.y + area.height), 0, ImVec2(0.0f, 1.0f));
  ImGui::SetNextWindowSizeConstraints(vector(area.width, 0.0), vector(area.width, 0.75 * area.height));
  ImGui::Begin("##help", nullptr,
               ImGuiWindowFlags_NoTitleBar | ImGuiWindowFlags_NoResize | ImGuiWindowFlags_NoSavedSettings |
                   ImGuiWindowFlags_NoMove | ImGuiWindowFlags_NoNav | ImGuiWindowFlags_AlwaysAutoResize);
  ImGui::PushTextWrapPos(static_cast<float>(area.width) - 16.0f);
  ImGui::TextUnformatted(mouse_help());
  ImGui::PopTextWrapPos();
  std::size_t groups = 1;
  for (std::size_t i = 1; i < keys_.size(); ++i) groups += keys_[i].group != keys_[i - 1].group;
  const std::size_t lines = (keys_.size() + groups + columns - 1) / columns;
  ImGui::Columns(static_cast<int>(columns), "##shortcuts", false);
  std::size_t line = 0;
  for (std::size_t i = 0; i < keys_.size(); ++i) {
    const bool begins = i == 0 || keys_[i].group != keys_[i - 1].group;
    // A heading stays with its first key.
    if (line + begins >= lines && line > 0) {
      ImGui::NextColumn();
      line = 0;
    }
    line += help_line(keys_[i], begins);
  }
  ImGui::Columns(1);
  help_height_ = ImGui::GetWindowHeight();
  ImGui::End();
}

void ViewerWindow::draw_dialog(const Area& area) {
  FileDialog& shown = *dialog;
  const bool opens = shown.purpose == FileDialog::Purpose::open;
  const double width = std::min(640.0, area.width - 24.0);
  ImGui::SetNextWindowPos(vector(area.x + 0.5 * area.width, area.y + 40.0), 0, ImVec2(0.5f, 0.0f));
  ImGui::SetNextWindowSize(vector(width, 0.0));
  ImGui::SetNextWindowBgAlpha(1.0f);
  if (shown.is_new) ImGui::SetNextWindowFocus();
  ImGui::Begin("##dialog", nullptr,
               ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_NoMove |
                   ImGuiWindowFlags_NoNav | ImGuiWindowFlags_AlwaysAutoResize);
  heading(opens ? "OPEN A LIGHT MAP OR A FIELD" : "SAVE THE PICTURE");
  if (!opens) ImGui::TextDisabled("%s", ".exr: scene-linear; .png: as shown");
  if (shown.is_new) ImGui::SetKeyboardFocusHere();
  shown.is_new = false;
  ImGui::SetNextItemWidth(-1.0f);
  std::optional<fs::path> chosen;
  if (ImGui::InputTextWithHint("##path", "Name or path, then Enter", shown.typed.data(), shown.typed.size(),
                               ImGuiInputTextFlags_EnterReturnsTrue | ImGuiInputTextFlags_AutoSelectAll))
    chosen = typed_path(shown);
  const auto in_folder = draw_folder(shown, std::clamp(area.height - 360.0, 90.0, 260.0));
  if (opens && in_folder) chosen = in_folder;  // a click opens; saving over a file takes one more
  if (button(opens ? "Open file" : "Save file")) chosen = typed_path(shown);
  ImGui::SameLine();
  const bool is_left = button("Cancel");
  ImGui::End();
  if (!chosen && !is_left) return;
  attempt([&] {
    if (chosen) opens ? open(*chosen) : save(*chosen);
  });
  dialog.reset();
}

void open_window(const std::string& name, const std::string& reads,
                 const std::function<std::unique_ptr<ViewerWindow>()>& read, const WindowOptions& options,
                 const RunContext& context) {
  constexpr std::chrono::milliseconds patience_before_window(150), frame(50);
  BackgroundJob<std::unique_ptr<ViewerWindow>> reading(read);
  std::unique_ptr<ViewerWindow> early;
  const auto start = Clock::now();
  if (reading.wait_for(patience_before_window)) early = reading.take();  // errors come before a window
  GlWindow window(options.width, options.height);
  std::unique_ptr<ViewerWindow> viewer = std::move(early);  // gone before the window
  while (!viewer) {
    if (window.is_closed()) return;
    context.throw_if_stopped();
    window.collect(0.0);
    window.begin_frame();
    const std::string text =
        reads + " " + name + formatted(" … %.0f s", milliseconds_between(start, Clock::now()) / 1000.0);
    const ImVec2 size = ImGui::CalcTextSize(text.c_str()), all = ImGui::GetIO().DisplaySize;
    ImGui::GetBackgroundDrawList()->AddText(vector(0.5 * (all.x - size.x), 0.5 * (all.y - size.y)),
                                            text_colour, text.c_str());
    window.end_frame(nullptr);
    if (reading.wait_for(frame)) viewer = reading.take();
  }
  viewer->show_in(window);
}

}  // namespace refield
