// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <optional>
#include <string>

namespace refield {

struct ViewerOptions {
  std::filesystem::path field;
  std::optional<std::filesystem::path> light;  ///< a map to begin with
  std::optional<std::string> script;           ///< a file of commands, or "-"
  int width = 1440;                            ///< of the window, in pixels
  int height = 900;
};

/// Whether this program was built with GLFW and Dear ImGui.
bool has_viewer();

/// Opens a window on a field and returns when it is closed. Throws DeviceError where there is no display or
/// no OpenGL 3.3, what the readers of field and light throw, and InputError for a wrong line of the script.
void run_viewer(const ViewerOptions& options);

}  // namespace refield
