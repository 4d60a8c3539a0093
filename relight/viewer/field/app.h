// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "relight/viewer/field/view_state.h"
#include "relight/viewer/gui/background_job.h"
#include "relight/viewer/gui/canvas.h"
#include "relight/viewer/gui/gl_window.h"
#include "relight/viewer/gui/input.h"
#include "relight/viewer/gui/window_state.h"

namespace refield {

/// A light map, read and ready to go behind the light sources.
struct OpenedLight {
  std::filesystem::path file;
  LightMap map;                                            ///< that fits the field; empty for environments
  std::shared_ptr<const PreparedEnvironment> environment;  ///< instead
  std::shared_ptr<const EnvironmentProjector> projector;   ///< of it
  std::string note;                                        ///< what was done to the map
};

/// What a file held: a field or, with `state` null, a light map.
struct OpenedFile {
  std::filesystem::path file;
  std::unique_ptr<ViewState> state = nullptr;
  std::optional<OpenedLight> light = std::nullopt;  ///< with a field, too: the one to begin with
};

/// Read a field and, where there is one, a light map to begin with; a light map for a field of that domain
/// and those monitors. For threads in the background. Throw what the readers throw, InputError for a map that
/// does not fit. Of fields whose transfer takes large_transfer_bytes or more, only pixels that a window shows
/// are read. `monitors` stand in place of the field's where there are any.
OpenedFile read_field_file(const std::filesystem::path& field,
                           const std::optional<std::filesystem::path>& light, const RunContext& run,
                           const std::vector<MonitorPlacement>& monitors = {});
OpenedFile read_light_file(const std::filesystem::path& file, const LightDomain& domain,
                           const std::vector<MonitorPlacement>& monitors, const RunContext& run);

/// The viewer of fields between frames: what is shown (ViewState) and how the window stands. Panels and
/// shortcuts change it.
struct App : WindowState {
  App(OpenedFile field, const RunContext& context);

  std::filesystem::path field_file;
  std::vector<MonitorPlacement> monitors;  ///< in place of those of fields; empty: theirs
  std::string light_name;                  ///< of the map behind the light sources; empty: none
  std::filesystem::path light_file;
  std::unique_ptr<ViewState> state;

  std::unique_ptr<BackgroundJob<OpenedFile>> opening;  ///< the file that is being read
  std::string opening_name;
  /// Those before it, cancelled: kept until they end, so that no one has to wait for them.
  std::vector<std::unique_ptr<BackgroundJob<OpenedFile>>> abandoned;
  bool tells_share = false;  ///< a new environment is being projected: say how much of it the monitor shows

  std::optional<std::size_t> selected;  ///< light source
  bool probes = false;                  ///< the left button probes the light instead of moving light sources
  int probe_texels = 1;                 ///< side of the probe
  bool shows_kernels = true;            ///< those of the picked pixel over the light map
  bool is_playing = false;
  bool is_smooth = true;  ///< pixels blend into each other when enlarged

  bool is_dragging = false;  ///< the camera, since the button went down

  Canvas picture, light;
};

/// Begins to read a field (.rfield) or a light map in the background; what was being read is given up.
void open_file(App& app, const std::filesystem::path& file);
/// Takes over what has been read since; errors become notices. Called once a frame.
void take_opened(App& app);
/// Whether another frame is due though nothing happened: a file is being read, an image relit.
bool is_busy(const App& app);

/// The relit image as it is (.exr), or tone-mapped (.png). Waits for it.
void save_picture(App& app, const std::filesystem::path& file);

void change_exposure(App& app, double stops);
void turn_light(App& app, double degrees);
void select_light_source_beside(App& app, int step);
void add_light_source_and_select(App& app, PaintedLight::Shape shape);
void change_selected(App& app, const std::function<void(PaintedLight&)>& change);
void remove_selected(App& app);
/// Moves what is in motion: light sources sweep, the map turns.
void advance_motion(App& app, double seconds);
/// Lights by a square of app.probe_texels around a point of the light map alone.
void probe_at(App& app, const Point& texel);

const std::vector<Shortcut<App>>& shortcuts();

/// What the panels draw pictures with.
struct Textures {
  Texture picture, light, kernels;
};

/// Draws all of a frame into Dear ImGui and lets mouse and controls change `app`. Calls `refresh` once they
/// have and before the picture is laid out, whose region may be another then.
void draw_panels(App& app, const Textures& textures, const std::function<void()>& refresh);

/// The part of the image that is in view. Nothing where it was moved out of it, and for meshes.
std::optional<VisibleRegion> visible_region(const App& app);

}  // namespace refield
