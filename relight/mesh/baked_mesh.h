// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <span>

#include <Eigen/Core>

#include "core/field/mesh.h"

namespace refield {

/// Writes a mesh whose vertices shine as `colours` [vertices] say, linear RGB, clamped to [0, 1], as binary
/// glTF 2.0 (.glb), atomically: colours of vertices (COLOR_0, float) on an unlit material
/// (KHR_materials_unlit), normals for those who want them. glTF is right-handed: z is negated and triangles
/// are turned around. Throws DeviceError where the system refuses.
void write_baked_mesh(const std::filesystem::path& path, const Mesh& mesh,
                      std::span<const Eigen::Array3f> colours);

}  // namespace refield
