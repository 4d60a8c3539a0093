// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>

#include "relight/viewer/canvas.h"
#include "relight/viewer/orbit_camera.h"
#include "relight/viewer/script.h"

namespace refield {

// What scripts do with cameras and tell of them, whatever is shown.

/// Orbits, approaches or pans. Throws InputError for a factor that is none.
void move_camera(OrbitCamera& camera, const ScriptCommand& command);

/// JSON: where a picture lies in the window, in the window's pixels.
std::string canvas_text(const Canvas& canvas, int width, int height);
/// `"camera": {…}`.
std::string camera_text(const PinholeCamera& camera);

}  // namespace refield
