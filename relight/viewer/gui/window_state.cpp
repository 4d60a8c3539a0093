// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/gui/window_state.h"

#include <algorithm>
#include <string>
#include <string_view>

#include "core/base/number_text.h"
#include "core/image/image_io.h"

namespace refield {

namespace fs = std::filesystem;

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
