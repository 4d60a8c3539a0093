// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>

#include "relight/viewer/scene/moving_scene.h"

namespace refield::cli {

/// A description of a moving scene (TOML, docs/reference/mesh-scenes.md) with all that is computed ahead, for
/// the viewer. Throws what read_dynamic_scene() throws, and Interrupted.
MovingScene read_moving_scene(const std::filesystem::path& path);

}  // namespace refield::cli
