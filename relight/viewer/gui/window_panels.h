// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "core/image/image.h"
#include "relight/viewer/gui/canvas.h"
#include "relight/viewer/gui/input.h"
#include "relight/viewer/gui/window_state.h"

namespace refield {

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

/// Draws the window's dialog, where it has one, over an area, and calls `take` with the file that was chosen.
/// `recent`: files that are offered first when one is opened.
void draw_file_dialog(WindowState& window, const Area& area, std::span<const std::filesystem::path> recent,
                      const std::function<void(const std::filesystem::path&)>& take);

}  // namespace refield
