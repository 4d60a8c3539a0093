// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <string>
#include <vector>

namespace refield::prt {

/// A mesh file's extension in lower case, without the dot.
std::string mesh_format_of(const std::filesystem::path& path);

/// What assimp makes of the mesh file that is the only argument, as bytes for import_mesh(): 'E' and an
/// error, or 'M' and positions, normals, colours, triangles and the number of materials, each as a count and
/// values. Assimp is not made for hostile files: where files may be, call it in a process of its own. Not for
/// several threads at once.
std::string read_with_mesh_library(const std::vector<std::string>& arguments);

}  // namespace refield::prt
