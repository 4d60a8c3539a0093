// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include "core/base/run_context.h"

namespace refield::prt {

/// What a mesh's file says: right-handed, in the file's own units, a vertex possibly once for each of its
/// triangles.
struct ImportedMesh {
  std::vector<Eigen::Vector3f> positions;               ///< [vertices], finite
  std::vector<Eigen::Vector3f> normals;                 ///< [vertices] or, where the file has none, empty
  std::vector<Eigen::Array3f> colours;                  ///< [vertices] as the file encodes them, or empty
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< indices in range
  std::uint64_t ignored_materials = 0;                  ///< that the parts use: none is read
};

/// How a file's vertex colours are encoded.
enum class ColourCoding { srgb, linear };
/// glTF prescribes linear; what writes colours into OBJ, PLY and OFF takes them from photographs.
ColourCoding usual_colour_coding(const std::filesystem::path& path);

/// Reads OBJ, PLY, OFF, glTF and GLB, represented by the file's name, with all their parts in place.
/// Draco-compressed glTF is read where the library was built with its decoder, as Debian's is. The library
/// (assimp) is not made for hostile files, so where files may be hostile, run.read_isolated calls it in
/// another process, with limits.
/// Throws FormatError for what is no mesh, breaks its format, holds coordinates that are not finite or asks
/// for more than the limits; DeviceError where the file cannot be read.
ImportedMesh import_mesh(const std::filesystem::path& path, const RunContext& run);

}  // namespace refield::prt
