// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <string>
#include <vector>

namespace refield::prt {

/// A mesh file's extension in lower case, without the dot.
std::string mesh_format_of(const std::filesystem::path& path);

/// Whether `file` is a regular one in the folder of the mesh file `mesh` or below, symbolic links followed: a
/// mesh from elsewhere shall not make this program read other files of the user, nor wait for a pipe. Where
/// it is there and is not, `refused` says why.
bool may_be_read_for(const std::filesystem::path& mesh, const std::filesystem::path& file,
                     std::string* refused = nullptr);

/// What assimp makes of the mesh file that is the only argument, as bytes for import_mesh(): 'E' and an
/// error, or 'M' and the arrays of ImportedMesh, each as a count and values; for textures the lengths of
/// names and contents, then those. Assimp is not made for hostile files: where files may be, call it in a
/// process of its own. Not for several threads at once.
std::string read_with_mesh_library(const std::vector<std::string>& arguments);

}  // namespace refield::prt
