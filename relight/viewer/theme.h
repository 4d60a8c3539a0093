// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace refield {

struct WindowColour {
  float red, green, blue;
};

/// Neutral greys around pictures, so that they alone have colour; amber marks what is selected.
void apply_theme(float scale);
WindowColour background_colour();

}  // namespace refield
