// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "cli/acquire/session_rig.h"

namespace refield::cli {

/// Prints an image on the terminal in 24-bit colour, two pixels per character, no wider than the terminal.
/// Returns the number of lines.
int print_image(const Image& image);

/// A raw frame as an image, linear, of any unit; nothing about the camera needs to be known.
Image image_of(const RawFrame& frame, const CameraDescription& camera);

/// Shows the frames of the camera on the terminal under a white monitor, each with its sharpness, until Enter
/// is pressed; the exposure follows the brightness. Of a camera that takes photographs, one is shown.
void live_view(SessionRig& rig, double gain);

}  // namespace refield::cli
