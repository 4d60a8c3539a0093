// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "acquire/capture/capture.h"
#include "cli/acquire/session_rig.h"

namespace refield::cli {

/// The images that `pattern` (a quoted pattern or a folder) names, as training lights, but for references by
/// their name. The kind is that of the texels, kind_of_light().
std::vector<CaptureLight> lights_of_files(const std::string& pattern);

/// The lights of a session, with their roles and kinds.
std::vector<CaptureLight> lights_of_session(const std::filesystem::path& folder);

/// A light map of one colour.
Image uniform_light(int width, int height, const std::array<float, 3>& colour);

/// Puts the monitor's primaries, one at a time, before the lights where none is one yet, since captures may
/// end early, and gives the white light to repeat as the reference: that of the lights, which are then
/// without it, else, like the primaries, one that is written into `folder` with the radiance `white`.
std::filesystem::path add_primaries_and_white(std::vector<CaptureLight>& lights, int width, int height,
                                              float white, const std::filesystem::path& folder);

/// Puts frames of one light, to tell drift by, first, last, and after every `every` lights (0: none). Without
/// a `reference` it is the white one among the lights, else the first.
std::vector<CaptureLight> with_references(const std::vector<CaptureLight>& lights, int every,
                                          std::filesystem::path reference);

}  // namespace refield::cli
