// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "relight/viewer/gl_window.h"
#include "relight/viewer/scene/scene_app.h"

namespace refield {

/// Draws all of a frame into Dear ImGui and lets mouse and controls change `app`.
void draw_scene_panels(SceneApp& app, const Texture& picture);

}  // namespace refield
