// SPDX-License-Identifier: Apache-2.0
// Stands in for viewer.cpp where GLFW or Dear ImGui was not there when the program was configured.
#include <cerrno>

#include "core/base/errors.h"
#include "relight/viewer/scene/moving_scene.h"
#include "relight/viewer/viewer.h"

namespace refield {

bool has_viewer() {
  return false;
}

namespace {

[[noreturn]] void refuse() {
  throw DeviceError(
      "viewer", ENOSYS,
      "this program was built without a window; install libglfw3-dev, libimgui-dev and libgl-dev and build "
      "it again, or write files with 'refield relight' and 'refield simulate dynamic'");
}

}  // namespace

void run_viewer(const std::filesystem::path&, const std::optional<std::filesystem::path>&,
                const WindowOptions&, const RunContext&) {
  refuse();
}

void run_scene_viewer(const std::string&, const std::function<MovingScene()>&, const WindowOptions&,
                      const RunContext&) {
  refuse();
}

}  // namespace refield
