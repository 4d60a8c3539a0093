// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "relight/viewer/gui/gl_window.h"
#include "relight/viewer/gui/input.h"
#include "relight/viewer/gui/script.h"
#include "relight/viewer/gui/window_state.h"
#include "relight/viewer/scene/scene_state.h"

namespace refield {

/// What the left button holds: a thing by one of its points, or the camera.
struct HeldThing {
  std::optional<std::size_t> thing;
  Eigen::Vector3f point = Eigen::Vector3f::Zero();
  Point pointer;             ///< in the window, when it was moved last
  bool is_dragging = false;  ///< further than a click may shake
};

/// The viewer of moving scenes between frames. Panels draw it and change it; so do shortcuts and scripts.
struct SceneApp : WindowState {
  SceneApp(MovingScene scene, const RunContext& context) : state(std::move(scene)) { run = context; }

  SceneState state;
  std::optional<std::size_t> selected;  ///< thing
  bool is_playing = false;              ///< the scene's own motion
  std::optional<HeldThing> held;

  Canvas picture;
};

/// Throws InputError, which names those that there are.
std::size_t thing_named(const SceneApp& app, const std::string& name);
/// Changes the selected thing, where there is one.
template <class Change>
void change_handling(SceneApp& app, const Change& change) {
  if (!app.selected) return;
  Handling handling = app.state.handling(*app.selected);
  change(handling);
  app.state.handle(*app.selected, handling);
}

/// The picture at rest as it is (.exr), or tone-mapped (.png).
void save_scene_picture(SceneApp& app, const std::filesystem::path& file);

const std::vector<Shortcut<SceneApp>>& scene_shortcuts();
/// What scripts can do; `app` must outlive it.
ScriptStage scene_stage(SceneApp& app);

/// Draws all of a frame into Dear ImGui and lets mouse and controls change `app`.
void draw_scene_panels(SceneApp& app, const Texture& picture);

}  // namespace refield
