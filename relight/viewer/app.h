// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "relight/viewer/canvas.h"
#include "relight/viewer/view_state.h"
#include "relight/viewer/window_state.h"

namespace refield {

/// The viewer of fields between frames: what is shown (ViewState) and how the window stands. Panels draw it
/// and change it; so do shortcuts and scripts.
struct App : WindowState {
  explicit App(const std::filesystem::path& field_path);

  std::filesystem::path field_file;
  std::string light_name;  ///< of the map behind the lamps; empty: none
  std::unique_ptr<ViewState> state;

  std::optional<std::size_t> selected;  ///< lamp
  bool probes = false;                  ///< the left button probes the light instead of moving lamps
  int probe_texels = 1;                 ///< side of the probe
  bool shows_kernels = true;            ///< those of the picked pixel over the light map
  bool is_playing = false;
  bool is_smooth = true;  ///< pixels blend into each other when enlarged

  bool is_dragging = false;  ///< the camera, since the button went down

  Canvas picture, light;
};

/// A field (.rfield) or a light map. Errors become notices.
void open_file(App& app, const std::filesystem::path& file);
/// The same; errors are thrown.
void load_light(App& app, const std::filesystem::path& file);

/// The relit image as it is (.exr), or tone-mapped (.png).
void save_picture(App& app, const std::filesystem::path& file);
void save_light(App& app, const std::filesystem::path& file);

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
