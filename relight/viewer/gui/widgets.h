// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>

#include "core/image/tone_map.h"
#include "relight/viewer/gui/window_state.h"

namespace refield {

// Controls of a panel, for every window of the viewer.

void heading(const char* text);
/// A control's name at the left, the control over the rest of the line.
void label(const char* text);
/// A button that scripts can find by its label.
bool button(WindowState& window, const char* label, bool is_on = false);
/// A slider over stops of a positive factor; true when it was moved.
bool stops_slider(const char* name, const char* id, double& factor, float low, float high);
/// Exposure and tone curve; true when they were changed.
bool tone_controls(WindowState& window, ToneMapping& tone);
/// Tells scripts where the item that was drawn last stands.
void note_control(WindowState& window, const std::string& name);
/// Save, screenshot and help. `stem`: of the saved picture's name.
void window_buttons(WindowState& window, const std::string& stem);

}  // namespace refield
