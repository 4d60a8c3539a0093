// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/gui/window_state.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>
#include <string_view>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/number_text.h"
#include "core/base/run_context.h"
#include "core/image/image_io.h"
#include "core/image/metrics.h"

namespace refield {

namespace fs = std::filesystem;

FrameStatistics frame_statistics(const std::vector<FrameTime>& frames) {
  FrameStatistics result;
  result.frames = frames.size();
  if (frames.empty()) return result;
  std::vector<float> totals;
  for (const FrameTime& frame : frames) {
    result.mean.total_ms += frame.total_ms;
    result.mean.view_ms += frame.view_ms;
    result.mean.tone_ms += frame.tone_ms;
    result.mean.draw_ms += frame.draw_ms;
    result.mean.relight_ms += frame.relight_ms;
    result.mean.light_ms += frame.light_ms;
    result.mean.wait_ms += frame.wait_ms;
    result.longest_ms = std::max(result.longest_ms, frame.total_ms);
    if (frame.relight_ms > 0.0) ++result.relit;
    totals.push_back(static_cast<float>(frame.total_ms));
  }
  const auto count = static_cast<double>(frames.size());
  result.mean.total_ms /= count;
  result.mean.view_ms /= count;
  result.mean.tone_ms /= count;
  result.mean.draw_ms /= count;
  result.mean.wait_ms /= count;
  if (result.relit > 0) {
    result.mean.relight_ms /= static_cast<double>(result.relit);
    result.mean.light_ms /= static_cast<double>(result.relit);
  }
  if (result.mean.total_ms > 0.0) result.per_second = 1000.0 / result.mean.total_ms;
  result.percentile_95_ms = quantile(std::move(totals), 0.95);
  return result;
}

std::string text_of(const FrameStatistics& statistics) {
  char text[300], view[40] = "", light[40] = "";
  if (statistics.mean.view_ms > 0.0)
    std::snprintf(view, sizeof view, " view %.1f ms,", statistics.mean.view_ms);
  if (statistics.mean.light_ms > 0.0)
    std::snprintf(light, sizeof light, "light map %.1f ms and ", statistics.mean.light_ms);
  std::snprintf(
      text, sizeof text,
      "%zu frames, %.1f per second (95 %% within %.1f ms, longest %.1f ms): %srelighting %.1f ms in "
      "%zu of them,%s tone mapping %.1f ms, drawing %.1f ms",
      statistics.frames, statistics.per_second, statistics.percentile_95_ms, statistics.longest_ms, light,
      statistics.mean.relight_ms, statistics.relit, view, statistics.mean.tone_ms, statistics.mean.draw_ms);
  return text;
}

namespace {

void notify(WindowState& window, const std::string& text, bool is_error, std::chrono::seconds duration) {
  window.run.note(text);
  window.notice = Notice{text, is_error, std::chrono::steady_clock::now() + duration};
}

constexpr std::array<std::string_view, 8> opened_extensions = {".rfield", ".exr",  ".hdr", ".png",
                                                               ".jpg",    ".jpeg", ".tif", ".tiff"};

constexpr std::size_t max_list_bytes = std::size_t{1} << 16;
constexpr std::size_t max_path_bytes = 4096;

bool is_path(const std::string& line) {
  return line.size() <= max_path_bytes && line.starts_with('/') &&
         std::ranges::none_of(line, [](char c) { return static_cast<unsigned char>(c) < ' ' || c == 127; });
}

std::vector<fs::path> read_list(const fs::path& list) {
  std::vector<fs::path> files;
  std::error_code error;
  if (!fs::is_regular_file(list, error)) return files;
  std::ifstream stream(list, std::ios::binary);
  std::string text(max_list_bytes, '\0');
  stream.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(std::max<std::streamsize>(stream.gcount(), 0)));
  for (std::size_t start = 0; start < text.size() && files.size() < RecentFiles::max_files;) {
    const std::size_t end = std::min(text.find('\n', start), text.size());
    const std::string line = text.substr(start, end - start);
    if (is_path(line) && std::ranges::find(files, fs::path(line)) == files.end()) files.emplace_back(line);
    start = end + 1;
  }
  return files;
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

void ask_where_to_save(WindowState& window, const std::string& stem) {
  window.dialog.emplace(FileDialog::Purpose::save, ".");
  window.dialog->type(free_name(stem, ".exr").string());
}

std::string controls_text(const WindowState& window) {
  nlohmann::json visible = nlohmann::json::object();
  for (const auto& [label, control] : window.controls)
    if (control.is_visible) visible[label] = {std::lround(control.middle.x), std::lround(control.middle.y)};
  return "\"controls\": " + visible.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

void say(WindowState& window, const std::string& text) {
  notify(window, text, false, std::chrono::seconds(4));
}

void complain(WindowState& window, const std::string& text) {
  notify(window, text, true, std::chrono::seconds(10));
}

fs::path free_name(const std::string& stem, const std::string& extension) {
  for (int i = 1;; ++i) {
    fs::path name = stem + formatted("-%04d", i) + extension;
    if (!fs::exists(name)) return name;
  }
}

void save_image(WindowState& window, const fs::path& file, const Image& linear, const ToneMapping& tone,
                ColourSpace space) {
  if (file.extension() == ".exr")
    write_exr(file, linear, Precision::single, space);
  else if (file.extension() == ".png")
    write_png(file, linear, tone);
  else
    throw InputError(file.string() + ": pictures are saved as .exr (scene-linear) or .png");
  say(window, "Saved " + file.string());
}

void save_both(WindowState& window, const std::string& stem,
               const std::function<void(const fs::path&)>& save) {
  try {
    const fs::path file = free_name(stem, ".exr");
    save(file);
    save(fs::path(file).replace_extension(".png"));
  } catch (const Error& error) {
    complain(window, error.what());
  }
}

RecentFiles::RecentFiles(fs::path list) : list_(std::move(list)) {
  if (!list_.empty()) files_ = read_list(list_);
}

fs::path RecentFiles::list_from_environment() {
  const char* state = std::getenv("XDG_STATE_HOME");
  if (state != nullptr && *state == '/') return fs::path(state) / "refield" / "recent";
  const char* home = std::getenv("HOME");
  return home != nullptr && *home == '/' ? fs::path(home) / ".local" / "state" / "refield" / "recent"
                                         : fs::path();
}

void RecentFiles::add(const fs::path& file) {
  std::error_code error;
  const fs::path absolute = fs::absolute(file, error).lexically_normal();
  if (error || !is_path(absolute.string())) return;
  if (!list_.empty()) files_ = read_list(list_);  // another window may have added some
  std::erase(files_, absolute);
  files_.insert(files_.begin(), absolute);
  if (files_.size() > max_files) files_.resize(max_files);
  if (list_.empty()) return;
  std::string text;
  for (const fs::path& each : files_) text += each.string() + "\n";
  try {
    create_folders(list_.parent_path());
    write_text_atomically(list_, text);
  } catch (const Error&) {
    // Of a disk that is full or cannot be written: the list lasts until the window is closed.
  }
}

}  // namespace refield
