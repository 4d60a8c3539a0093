// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>

#include "core/base/run_context.h"
#include "core/field/mesh.h"
#include "simulate/geometry/mesh_import.h"

namespace refield::prt {

/// Normals from the triangles: at each vertex the mean of theirs, weighted by area. A vertex whose triangles
/// cancel out takes the first one's.
void compute_normals(Mesh& mesh);

/// A third of each triangle around it, [vertices].
std::vector<float> vertex_areas(std::span<const Eigen::Vector3f> positions,
                                std::span<const std::array<std::uint32_t, 3>> triangles);

/// What becomes of the specular part of a file's materials.
enum class Gloss {
  lobes,    ///< it is kept beside the diffuse part
  diffuse,  ///< it is reflected diffusely, with the same reflectance, for what has no view
};

struct MeshFileOptions {
  std::optional<ColourCoding> coding{};  ///< of vertex colours; none: usual_colour_coding()
  bool materials = true;                 ///< whether the file's materials are read
  Gloss gloss = Gloss::lobes;
};

struct MeshFile {
  Mesh mesh;
  bool has_materials = false;  ///< colours are all of the diffuse reflectance, not factors of it
  /// [vertices] RGB reflectance of the lobe at normal incidence and its roughness (GGX α is its square, at
  /// least min_roughness), the same for the three vertices of a triangle; a diffuse vertex has 0, 0, 0, 1.
  /// Empty where all are diffuse.
  std::vector<Eigen::Array4f> lobes{};
};

/// Lobes narrower than this become as wide as this.
inline constexpr float min_roughness = 0.1f;
/// Lobes wider than this are reflected diffusely. From here on, Lambert's reflection is as close to a GGX
/// lobe as Phong's is: seen from 10°, 35° and 60°, both differ from it by 1.2 of its root mean square at
/// roughness 0.9; at 0.8 by 0.78 and 0.76, at 0.7 by 0.61 and 0.50.
inline constexpr float max_roughness = 0.9f;

/// Reads a mesh (import_mesh()) into the axes of core/field/mesh.h: z is negated and triangles are turned
/// around. Vertices of equal position, colour and material become one, unless the file gives them normals
/// that differ: so its hard edges stay hard. Normals are computed anew, weighted by area, over colours and
/// materials. Triangles without area and vertices without triangle are left out, which run.note tells.
/// Colours are those of the vertices, clamped to [0, 1]; a file without is white. They multiply the base
/// colour of vertex_materials(), which metallic-roughness shares out (glTF 2.0, appendix B): with m the
/// metallic factor, lobe F0 = (1 − m) specular + m base and colour = (1 − m) (1 − specular) base. Throws as
/// import_mesh(), and FormatError where no triangle is left.
MeshFile read_mesh_file(const fs::path& path, const MeshFileOptions& options = {},
                        const RunContext& run = {});

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
std::vector<VertexMaterial> vertex_materials(const ImportedMesh& mesh, const fs::path& path,
                                             const RunContext& run);

}  // namespace refield::prt
