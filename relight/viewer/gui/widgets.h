// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <imgui.h>

#include "relight/viewer/gui/canvas.h"

namespace refield {

/// 0xAABBGGRR, as Dear ImGui takes colours.
using PackedColour = unsigned;
inline constexpr PackedColour accent_colour = 0xff3da3f0;  // amber
inline constexpr PackedColour canvas_colour = 0xff161616;
inline constexpr PackedColour shadow_colour = 0xb0000000;
inline constexpr PackedColour text_colour = 0xffdcdcdc;

inline constexpr double panel_gap = 8.0;  ///< window pixels between panels

/// What Dear ImGui takes for a place or an extent.
inline ImVec2 vector(double x, double y) {
  return {static_cast<float>(x), static_cast<float>(y)};
}
inline ImVec2 vector(const Point& point) {
  return vector(point.x, point.y);
}

/// Begins a panel without frame or title in an area of the window. `padded`: room at its edges.
void begin_panel(const char* name, const Area& area, bool padded);
void end_panel();

/// Begins a panel that is all picture, and an item that takes the mouse.
void begin_canvas(const char* name, const Area& area);

/// A ring around what is selected.
void draw_ring(const Point& middle, double radius);
/// Text on a dark plate, the area's corner given; returns the plate's width.
double draw_plate(const Point& corner, const char* text, PackedColour colour);
/// The false colours in a row, with a label at either end.
void draw_legend(const Area& area, const char* low, const char* high);

// Controls of a panel, for every window of the viewer.

void heading(const char* text);
/// A control's name at the left, the control over the rest of the line.
void label(const char* text);
bool button(const char* label, bool is_on = false);
/// A slider over stops of a positive factor; true when it was moved.
bool stops_slider(const char* name, const char* id, double& factor, float low, float high);

}  // namespace refield
