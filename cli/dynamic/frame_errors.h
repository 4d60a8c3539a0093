// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <nlohmann/json_fwd.hpp>

#include "cli/dynamic/prepared_scene.h"

namespace refield::cli {

/// Rows "direct", "bounce 1" …, "all": relative RMSE of radiance towards the camera at up to 500 vertices
/// that face it, drawn evenly by a fixed seed, against `paths` paths a vertex: of that light itself, and of
/// all light; and the share that the light has in all.
nlohmann::ordered_json frame_errors(PreparedScene& scene, double time, const dynamic::FrameOptions& options,
                                    int paths);

}  // namespace refield::cli
