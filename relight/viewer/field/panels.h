// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>
#include <optional>

#include "relight/viewer/field/app.h"
#include "relight/viewer/gui/gl_window.h"

namespace refield {

/// What the panels draw pictures with.
struct Textures {
  Texture picture, light, kernels;
};

/// Draws all of a frame into Dear ImGui and lets mouse and controls change `app`. Calls `refresh` once they
/// have and before the picture is laid out, whose region may be another then.
void draw_panels(App& app, const Textures& textures, const std::function<void()>& refresh);

/// The part of the image that is in view. Nothing where it was moved out of it, and for meshes.
std::optional<VisibleRegion> visible_region(const App& app);

}  // namespace refield
