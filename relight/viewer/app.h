// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <chrono>
#include <deque>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "relight/viewer/canvas.h"
#include "relight/viewer/frame_times.h"
#include "relight/viewer/input.h"
#include "relight/viewer/view_state.h"

namespace refield {

/// A word to the user, shown for a few seconds.
struct Notice {
  std::string text;
  bool is_error = false;
  std::chrono::steady_clock::time_point until;
};

/// The viewer between frames: what is shown (ViewState) and how the window stands. Panels draw it and change
/// it; so do shortcuts and scripts.
struct App {
  explicit App(const std::filesystem::path& field_path);

  std::filesystem::path field_file;
  std::string light_name;  ///< of the map behind the lamps; empty: none
  std::unique_ptr<ViewState> state;

  std::optional<std::size_t> selected;  ///< lamp
  bool probes = false;                  ///< the left button probes the light instead of moving lamps
  int probe_texels = 1;                 ///< side of the probe
  bool shows_kernels = true;            ///< those of the picked pixel over the light map
  bool shows_help = false;
  bool is_playing = false;
  bool is_smooth = true;  ///< pixels blend into each other when enlarged

  bool is_dragging = false;  ///< the camera, since the button went down

  Canvas picture, light;
  std::map<std::string, Point> controls;  ///< the middle of every button, by its label; for scripts
  std::optional<Notice> notice;
  std::deque<FrameTime> recent_frames;
  bool wants_screenshot = false;  ///< of the window, into a new file
  bool wants_to_close = false;
};

void say(App& app, const std::string& text);
void complain(App& app, const std::string& text);

/// A field (.rfield) or a light map. Errors become notices.
void open_file(App& app, const std::filesystem::path& file);
/// The same; errors are thrown.
void load_light(App& app, const std::filesystem::path& file);

/// The relit image as it is (.exr), or tone-mapped (.png).
void save_picture(App& app, const std::filesystem::path& file);
void save_light(App& app, const std::filesystem::path& file);
/// A name in the working folder that no file has yet: "view-0001.png".
std::filesystem::path free_name(const std::string& stem, const std::string& extension);

void change_exposure(App& app, double stops);
void turn_light(App& app, double degrees);
void select_lamp_beside(App& app, int step);
void add_lamp_and_select(App& app, Lamp::Shape shape);
void change_selected(App& app, const std::function<void(Lamp&)>& change);
void remove_selected(App& app);
/// Moves what is in motion: lamps sweep, the map turns.
void advance_motion(App& app, double seconds);
/// Lights by a square of app.probe_texels around a point of the light map alone.
void probe_at(App& app, const Point& texel);

}  // namespace refield
