// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>

#include <filesystem>
#include <vector>

#include "core/base/run_context.h"
#include "simulate/geometry/mesh_import.h"

namespace refield::prt {

/// The material at a vertex, by glTF 2.0 (appendix B): metallic-roughness. All in [0, 1], colours linear RGB.
struct VertexMaterial {
  Eigen::Array3f base_colour;
  Eigen::Array3f specular;  ///< reflectance at normal incidence where it is no metal
  float metallic;
  float roughness;  ///< GGX α is its square; the same over a material
};

/// Materials at the vertices of a file: factors times textures. Empty where the file has no materials. A
/// vertex takes the mean of a texture around it, half of its mean edge far, so that a texture finer than the
/// mesh does not alias; the roughness is then averaged over each material. Textures repeat. One that cannot
/// be read counts as white; run.note tells so, and what else of the materials is not read. Factors outside
/// [0, 1] are clamped, those that are not finite are 0.
std::vector<VertexMaterial> vertex_materials(const ImportedMesh& mesh, const std::filesystem::path& path,
                                             const RunContext& run);

}  // namespace refield::prt
