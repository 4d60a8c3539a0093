// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "core/base/run_context.h"

namespace refield {

struct MovingScene;

struct WindowOptions {
  std::optional<std::string> script;  ///< a file of commands, or "-"
  int width = 1440;                   ///< pixels
  int height = 900;
};

/// Opens a window on a field, with a light map to begin with, and returns when it is closed. Throws
/// DeviceError where there is no display or no OpenGL 3.3, what the readers of field and light throw, and
/// InputError for a wrong line of the script.
void run_viewer(const std::filesystem::path& field, const std::optional<std::filesystem::path>& light,
                const WindowOptions& options, const RunContext& run);

/// The same on a scene of which objects and light sources move, by themselves and by hand. `read` runs in a
/// thread of its own, with a message in the window where it takes long; what it throws is thrown.
void run_scene_viewer(const std::string& name, const std::function<MovingScene()>& read,
                      const WindowOptions& options, const RunContext& run);

}  // namespace refield
