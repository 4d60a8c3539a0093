// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>

#include "core/session/capture_session.h"

namespace refield {

/// Rows of a photograph beyond those wanted that undo_rig() needs, above and below.
int rig_margin(const FrameCorrection* correction);

/// Undoes shift, gain and colour mixing of `rows`, rows [first_row, first_row + rows.height) of a photograph,
/// and returns those from `first` to `last`. One interpolation (Keys' cubic convolution, a = −1/2); a sample
/// that needs one that was not measured (NaN) is not measured, and no channel of a pixel is where one is
/// not. Beyond the picture's edges the nearest pixel counts.
Image undo_rig(const Image& rows, int first_row, int first, int last, const FrameCorrection& correction);

/// Weights of the pixels −1, 0, 1, 2 for a value `t` in [0, 1) after pixel 0. Source: Keys 1981, eq. 15.
std::array<float, 4> cubic_weights(double t);

}  // namespace refield
