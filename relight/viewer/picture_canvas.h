// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/image.h"
#include "relight/viewer/canvas.h"
#include "relight/viewer/free_view.h"
#include "relight/viewer/gl_window.h"

namespace refield {

// A panel that is a picture, for every window of the viewer.

/// The camera's next picture is of the area's size, and stands in it unmoved.
void fill_area(const Area& area, Canvas& canvas, FreeView& view);
/// Lays out a picture in a panel of its own, all of which is an item that takes the mouse.
void begin_picture_panel(const Area& area, Canvas& canvas, const Image& picture);
void draw_picture(const Canvas& canvas, const Image& picture, const Texture& texture);

}  // namespace refield
