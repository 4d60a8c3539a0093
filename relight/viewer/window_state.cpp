// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/window_state.h"

#include <cstdio>

#include "core/errors.h"
#include "core/image_io.h"
#include "core/progress.h"

namespace refield {

namespace fs = std::filesystem;

namespace {

void notify(WindowState& window, const std::string& text, bool is_error, std::chrono::seconds duration) {
  log_line(text);
  window.notice = Notice{text, is_error, std::chrono::steady_clock::now() + duration};
}

}  // namespace

void say(WindowState& window, const std::string& text) {
  notify(window, text, false, std::chrono::seconds(4));
}

void complain(WindowState& window, const std::string& text) {
  notify(window, text, true, std::chrono::seconds(10));
}

fs::path free_name(const std::string& stem, const std::string& extension) {
  for (int i = 1;; ++i) {
    char number[16];
    std::snprintf(number, sizeof number, "-%04d", i);
    fs::path name = stem + number + extension;
    if (!fs::exists(name)) return name;
  }
}

void save_image(WindowState& window, const fs::path& file, const Image& linear, const ToneMapping& tone) {
  if (file.extension() == ".exr")
    write_exr(file, linear);
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
