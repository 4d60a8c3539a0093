// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <imgui.h>

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "core/field_io/field_sampler.h"
#include "core/image/image.h"
#include "core/image/tone_map.h"
#include "relight/viewer/field/free_view.h"
#include "relight/viewer/gui/canvas.h"
#include "relight/viewer/gui/gl_window.h"
#include "relight/viewer/gui/input.h"
#include "relight/viewer/gui/window_state.h"

namespace refield {

/// 0xAABBGGRR, as Dear ImGui takes colours.
using PackedColour = unsigned;
inline constexpr PackedColour accent_colour = 0xff3da3f0;  // amber
inline constexpr PackedColour canvas_colour = 0xff161616;
inline constexpr PackedColour shadow_colour = 0xb0000000;
inline constexpr PackedColour text_colour = 0xffdcdcdc;

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

/// Text on a dark plate, the area's corner given; returns the plate's width.
double draw_plate(const Point& corner, const char* text, PackedColour colour);
/// The false colours in a row, with a label at either end.
void draw_legend(const Area& area, const char* low, const char* high);

// A panel that is a picture, for every window of the viewer.

/// The camera's next picture is of the area's size, and stands in it unmoved.
void fill_area(const Area& area, Canvas& canvas, FreeView& view);
/// Lays out a picture in a panel of its own, all of which is an item that takes the mouse.
void begin_picture_panel(const Area& area, Canvas& canvas, int picture_width, int picture_height);
/// The texture holds these pixels of the picture.
void draw_picture(const Canvas& canvas, const PixelGrid& pixels, const Texture& texture);

// Controls of a panel, for every window of the viewer.

void heading(const char* text);
/// A control's name at the left, the control over the rest of the line.
void label(const char* text);
bool button(const char* label, bool is_on = false);
/// A slider over stops of a positive factor; true when it was moved.
bool stops_slider(const char* name, const char* id, double& factor, float low, float high);
/// Exposure and tone curve; true when they were changed.
bool tone_controls(ToneMapping& tone);
/// Save, screenshot and help. `stem`: of the saved picture's name.
void window_buttons(WindowState& window, const std::string& stem);

// Panels that every window of the viewer has, each in an area of it.

/// A name, what lies under the pointer, and where the time of recent frames went.
void draw_status_bar(const WindowState& window, const Area& area, const std::string& name,
                     const std::string& pointer);
void draw_notice(WindowState& window, const Area& area);
/// What the mouse does, and all keys, in the lower part of an area; above_help() is what that leaves of it.
void draw_help(WindowState& window, const Area& area, const char* mouse,
               const std::vector<ShortcutKey>& keys);
Area above_help(const WindowState& window, const Area& area);

/// "pixel 3, 4:  0.1  0.2  0.3"; empty where the pointer is not over the image. `grid`: the pixels of the
/// canvas' image that `image` holds; nothing: all.
std::string pointer_text(const Canvas& canvas, const Image& image, const char* what,
                         const std::optional<PixelGrid>& grid = std::nullopt);

/// Draws the window's dialog, where it has one, over an area, and calls `take` with the chosen file;
/// errors become notices.
void draw_file_dialog(WindowState& window, const Area& area,
                      const std::function<void(const std::filesystem::path&)>& take);

}  // namespace refield
