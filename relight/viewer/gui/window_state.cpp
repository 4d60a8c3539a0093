// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/gui/window_state.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <string>
#include <string_view>

#include "core/base/errors.h"
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
    totals.push_back(static_cast<float>(frame.total_ms));
    result.longest_ms = std::max(result.longest_ms, frame.total_ms);
    result.relit += frame.relight_ms > 0.0;
  }
  const auto mean = [&](double FrameTime::*part, std::size_t count) {
    double sum = 0.0;
    for (const FrameTime& frame : frames) sum += frame.*part;
    return sum / static_cast<double>(std::max<std::size_t>(count, 1));
  };
  const std::size_t all = frames.size(), relit = result.relit;
  result.mean = {mean(&FrameTime::total_ms, all), mean(&FrameTime::relight_ms, relit),
                 mean(&FrameTime::tone_ms, all),  mean(&FrameTime::draw_ms, all),
                 mean(&FrameTime::view_ms, all),  mean(&FrameTime::light_ms, relit),
                 mean(&FrameTime::wait_ms, all)};
  if (result.mean.total_ms > 0.0) result.per_second = 1000.0 / result.mean.total_ms;
  result.percentile_95_ms = quantile(std::move(totals), 0.95);
  return result;
}

std::string text_of(const FrameStatistics& statistics) {
  const FrameTime& mean = statistics.mean;
  const std::string light = mean.light_ms > 0.0 ? formatted("light map %.1f ms and ", mean.light_ms) : "",
                    view = mean.view_ms > 0.0 ? formatted(" view %.1f ms,", mean.view_ms) : "";
  return formatted(
      "%zu frames, %.1f per second (95 %% within %.1f ms, longest %.1f ms): %srelighting %.1f ms in %zu of "
      "them,%s tone mapping %.1f ms, drawing %.1f ms",
      statistics.frames, statistics.per_second, statistics.percentile_95_ms, statistics.longest_ms,
      light.c_str(), mean.relight_ms, statistics.relit, view.c_str(), mean.tone_ms, mean.draw_ms);
}

namespace {

void notify(WindowState& window, const std::string& text, bool is_error, std::chrono::seconds duration) {
  window.run.note(text);
  window.notice = Notice{text, is_error, std::chrono::steady_clock::now() + duration};
}

constexpr std::array<std::string_view, 8> opened_extensions = {".rfield", ".exr",  ".hdr", ".png",
                                                               ".jpg",    ".jpeg", ".tif", ".tiff"};

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

}  // namespace refield
