// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <functional>
#include <span>

#include "relight/viewer/gui/canvas.h"
#include "relight/viewer/gui/window_state.h"

namespace refield {

/// Draws the window's dialog, where it has one, over an area, and calls `take` with the file that was chosen.
/// `recent`: files that are offered first when one is opened.
void draw_file_dialog(WindowState& window, const Area& area, std::span<const std::filesystem::path> recent,
                      const std::function<void(const std::filesystem::path&)>& take);

}  // namespace refield
