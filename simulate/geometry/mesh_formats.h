// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string_view>

#include "simulate/geometry/mesh_import.h"

namespace refield::prt {

/// Why a mesh is refused, in words that are not the file's.
struct MeshFault : std::runtime_error {
  template <class... Parts>
  explicit MeshFault(const Parts&... parts) : std::runtime_error(concatenated(parts...)) {}
};

/// A polygon over vertices of the mesh as triangles: ears are clipped, so it may be concave. Throws MeshFault
/// where it names a vertex that the mesh does not have.
void append_polygon(std::vector<std::uint32_t> corners, ImportedMesh& mesh);

/// The index in mesh.textures of an image file that the mesh file `path` names, in its folder or below; −1
/// where it is not there.
std::int32_t texture_beside(const fs::path& path, std::string name, ImportedMesh& mesh);

/// Of what is no metal, at normal incidence: index of refraction 1.5 (glTF 2.0, appendix B).
inline constexpr float dielectric_reflectance = 0.04f;

/// Marks factors outside [0, 1]; the base colour of a texture whose exporter left it black becomes white.
void note_excess(ImportedMaterial& material);

/// What a texture's coordinates are multiplied by and moved by.
struct TexturePlacement {
  Eigen::Matrix2f turn = Eigen::Matrix2f::Identity();
  Eigen::Vector2f offset = Eigen::Vector2f::Zero();
  bool operator==(const TexturePlacement&) const = default;
};

/// Files that are read without a library, since assimp 5.2 changes many of them silently: PLY of all
/// encodings (Turk 1994; polygons, strips and fans), OFF and its variants (Geomview) but four-dimensional and
/// binary ones, OBJ with polygons, and MTL (Ramey et al. 1995) with the extension for metallic-roughness.
/// `bytes`: the file. Throws MeshFault.
ImportedMesh read_ply(std::string_view bytes, const fs::path& path);
ImportedMesh read_off(std::string_view bytes);
ImportedMesh read_obj(std::string_view bytes, const fs::path& path);

/// A mesh file's extension in lower case, without the dot.
std::string mesh_format_of(const fs::path& path);

/// Whether `file` is a regular one in the folder of the mesh file `mesh` or below, symbolic links followed: a
/// mesh from elsewhere shall not make this program read other files of the user, nor wait for a pipe. Where
/// it is there and is not, `refused` says why.
bool may_be_read_for(const fs::path& mesh, const fs::path& file, std::string* refused = nullptr);

/// What assimp makes of the mesh file that is the only argument, as bytes for import_mesh(): 'E' and an
/// error, or 'M' and the arrays of ImportedMesh, each as a count and values; for textures the lengths of
/// names and contents, then those. Assimp is not made for hostile files: where files may be, call it in a
/// process of its own. Not for several threads at once.
std::string read_with_mesh_library(const std::vector<std::string>& arguments);

}  // namespace refield::prt
