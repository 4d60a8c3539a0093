// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "relight/viewer/field/app.h"
#include "relight/viewer/gui/gl_window.h"

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
/// The light map: move light sources, turn the map, probe.
void draw_light_panel(App& app, const Textures& textures, const Area& area);
/// Light sources, light and picture in numbers, and the picked pixel's kernels.
void draw_control_panel(App& app, const Area& area);

}  // namespace refield
