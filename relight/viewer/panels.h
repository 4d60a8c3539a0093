// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "relight/viewer/app.h"
#include "relight/viewer/gl_window.h"

namespace refield {

/// What the panels draw pictures with.
struct Textures {
  Texture picture, light, kernels;
};

/// Draws all of a frame into Dear ImGui and lets mouse and controls change `app`.
void draw_panels(App& app, const Textures& textures);

// Its parts, each in an area of the window.

/// The relit image: pick a pixel, zoom, pan.
void draw_picture_panel(App& app, const Textures& textures, const Area& area);
/// The light map: move lamps, turn the map, probe.
void draw_light_panel(App& app, const Textures& textures, const Area& area);
/// Lamps, light and picture in numbers, and the picked pixel's kernels.
void draw_control_panel(App& app, const Area& area);
void draw_status_bar(const App& app, const Area& area);
void draw_notice(App& app, const Area& area);
void draw_help(App& app, const Area& area);

/// A button that scripts can find by its label.
bool button(App& app, const char* label, bool is_on = false);

}  // namespace refield
