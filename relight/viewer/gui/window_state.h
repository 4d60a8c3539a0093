// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <chrono>
#include <deque>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/image/colour.h"
#include "core/image/image.h"
#include "core/image/tone_map.h"
#include "relight/viewer/gui/canvas.h"

namespace refield {

/// Where the time of one frame went.
struct FrameTime {
  double total_ms = 0.0;  ///< from one frame's start to the next one's, waiting for the user left out
  double relight_ms = 0.0;
  double tone_ms = 0.0;
  double draw_ms = 0.0;   ///< textures, panels, OpenGL until the frame is shown
  double view_ms = 0.0;   ///< of fields over a mesh: finding what the camera sees, and its picture
  double light_ms = 0.0;  ///< making the light map: turning or projecting a map, painting light sources
  double wait_ms = 0.0;   ///< of the frame: relighting, or waiting for it where it is done in the background
};

/// A word to the user, shown for a few seconds.
struct Notice {
  std::string text;
  bool is_error = false;
  std::chrono::steady_clock::time_point until;
};

/// Choosing a file to open or to save to, in one folder.
struct FileDialog {
  enum class Purpose { open, save };

  FileDialog(Purpose wanted, const std::filesystem::path& start);
  /// Lists a folder: its folders and what can be opened (fields, images), sorted, hidden ones left out. One
  /// that cannot be read is empty.
  void go_to(const std::filesystem::path& wanted);
  /// As if a user had typed it.
  void type(const std::string& text);

  Purpose purpose;
  std::filesystem::path folder;  ///< absolute
  std::vector<std::filesystem::path> folders, files;
  std::array<char, 4096> typed{};
  bool is_new = true;  ///< not yet drawn
};

/// What every window of the viewer keeps between frames, whatever it shows.
struct WindowState {
  RunContext run;  ///< for what the window starts; notices are notes, too
  std::optional<FileDialog> dialog;
  double help_height = 0.0;  ///< window pixels, as drawn last
  std::optional<Notice> notice;
  std::deque<FrameTime> recent_frames;
  bool shows_help = false;
  bool wants_screenshot = false;  ///< of the window, into a new file
  bool wants_to_close = false;
};

/// A dialog that saves under a free name of this stem.
void ask_where_to_save(WindowState& window, const std::string& stem);

void say(WindowState& window, const std::string& text);
void complain(WindowState& window, const std::string& text);

/// A name in the working folder that no file has yet: "view-0001.png".
std::filesystem::path free_name(const std::string& stem, const std::string& extension);

/// Writes a picture as it is (.exr) or tone-mapped (.png), and says so. Throws InputError for other files.
void save_image(WindowState& window, const std::filesystem::path& file, const Image& linear,
                const ToneMapping& tone, ColourSpace space = ColourSpace::camera);

/// Saves under one free name as .exr and as .png; errors become notices.
void save_both(WindowState& window, const std::string& stem,
               const std::function<void(const std::filesystem::path&)>& save);

}  // namespace refield
