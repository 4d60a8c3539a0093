// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "acquire/capture.h"
#include "cli/acquire/session_file.h"

namespace refield::cli {

/// Views of a lat-long panorama, turned step by step about the vertical axis, as training lights of width ×
/// height texels; they are written into `folder`. The panorama's brightness at `white_percentile` is shown as
/// `white`, the monitor's brightest radiance of each channel; what is brighter clips. Throws InputError for
/// an image that is no panorama.
std::vector<CaptureLight> panorama_lights(const SessionLights& wanted, int width, int height, float white,
                                          const std::filesystem::path& folder);

}  // namespace refield::cli
