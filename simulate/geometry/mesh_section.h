// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <filesystem>

#include "core/base/config_file.h"
#include "core/base/run_context.h"
#include "core/field/mesh.h"

namespace refield::prt {

/// Coordinates in files that people write are within this.
inline constexpr double farthest = 1e6;

Eigen::Vector3f read_vector(ConfigSection& section, const char* key, const Eigen::Vector3f& standard,
                            double low = -farthest, double high = farthest);
float read_number(ConfigSection& section, const char* key, float standard, double low, double high);

/// A mesh that a table describes by file or shape, and its place (docs/reference/mesh-scenes.md). Files are
/// relative to `folder`. Throws InputError and what read_mesh_file() does.
Mesh read_mesh(ConfigSection& section, const std::filesystem::path& folder, const RunContext& run);

/// [camera] of a scene. Throws InputError.
PinholeCamera read_camera(ConfigSection section);

}  // namespace refield::prt
