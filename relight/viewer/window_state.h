// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <chrono>
#include <deque>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>

#include "core/image.h"
#include "core/tone_map.h"
#include "relight/viewer/canvas.h"
#include "relight/viewer/frame_times.h"

namespace refield {

/// A word to the user, shown for a few seconds.
struct Notice {
  std::string text;
  bool is_error = false;
  std::chrono::steady_clock::time_point until;
};

/// What every window of the viewer keeps between frames, whatever it shows.
struct WindowState {
  std::map<std::string, Point> controls;  ///< the middle of every button, by its label; for scripts
  std::optional<Notice> notice;
  std::deque<FrameTime> recent_frames;
  bool shows_help = false;
  bool wants_screenshot = false;  ///< of the window, into a new file
  bool wants_to_close = false;
};

void say(WindowState& window, const std::string& text);
void complain(WindowState& window, const std::string& text);

/// A name in the working folder that no file has yet: "view-0001.png".
std::filesystem::path free_name(const std::string& stem, const std::string& extension);

/// Writes a picture as it is (.exr) or tone-mapped (.png), and says so. Throws InputError for other files.
void save_image(WindowState& window, const std::filesystem::path& file, const Image& linear,
                const ToneMapping& tone);

/// Saves under one free name as .exr and as .png; errors become notices.
void save_both(WindowState& window, const std::string& stem,
               const std::function<void(const std::filesystem::path&)>& save);

}  // namespace refield
