// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "relight/viewer/field/app.h"
#include "relight/viewer/gui/gl_window.h"

namespace refield {

/// What the panels draw pictures with.
struct Textures {
  Texture picture, light, kernels;
};

/// Draws all of a frame into Dear ImGui and lets mouse and controls change `app`.
void draw_panels(App& app, const Textures& textures);

}  // namespace refield
