// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>

#include <filesystem>
#include <vector>

#include "core/base/run_context.h"
#include "simulate/geometry/mesh_import.h"

namespace refield::prt {

/// Diffuse reflectance [vertices of the file] by its materials, linear RGB in [0, 1]: base colour times
/// texture. Empty where the file has no materials. A vertex takes the mean of the texture around it, half of
/// its mean edge far, so that a texture finer than the mesh does not alias. Textures repeat. One that cannot
/// be read counts as white; run.note tells so, and what else of the materials is not read.
std::vector<Eigen::Array3f> base_colours(const ImportedMesh& mesh, const std::filesystem::path& path,
                                         const RunContext& run);

}  // namespace refield::prt
