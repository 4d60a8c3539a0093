// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <array>
#include <vector>

#include "core/base/run_context.h"

namespace refield::prt {

/// What is not read of a file's materials.
enum IgnoredMaterialParts : std::uint32_t {
  ignored_layers = 1,  ///< clear coat, sheen, specular-glossiness, and textures of Ks and Ns
  ignored_relief = 2,  ///< normal, bump and displacement maps
  ignored_emission = 4,
  ignored_transparency = 8,
  ignored_texture = 16,  ///< by other coordinates than the first ones, or missing
  ignored_excess = 32,   ///< factors outside [0, 1], which are clamped
  ignored_back = 64,     ///< the other side of double-sided surfaces
  ignored_black = 128,   ///< a factor of zero beside a texture
};

/// A material of a file in the terms of glTF 2.0 (metallic-roughness), and what is not read of it. Factors as
/// the file has them, not limited to [0, 1]; textures: index in textures, −1: none.
struct ImportedMaterial {
  std::array<float, 3> base_colour{1.0f, 1.0f, 1.0f};  ///< linear RGB; times the texture
  /// Reflectance at normal incidence where it is no metal, linear RGB.
  std::array<float, 3> specular{0.0f, 0.0f, 0.0f};
  float metallic = 0.0f;                ///< times the blue channel of its texture
  float roughness = 1.0f;               ///< GGX α is its square; times the green channel of its texture
  std::int32_t texture = -1;            ///< of base_colour, sRGB
  std::int32_t metallic_texture = -1;   ///< linear
  std::int32_t roughness_texture = -1;  ///< linear
  std::uint32_t ignored = 0;            ///< IgnoredMaterialParts
  std::uint32_t is_of_the_file = 0;     ///< not one that the library made up
};

/// An image file beside the mesh, or inside it.
struct ImportedTexture {
  std::string file;     ///< in the mesh's folder or below; empty: inside
  std::string content;  ///< the image file's bytes, where it is inside
};

/// What a mesh's file says: right-handed, in the file's own units, a vertex possibly once for each of its
/// triangles.
struct ImportedMesh {
  std::vector<Eigen::Vector3f> positions;  ///< [vertices], finite
  std::vector<Eigen::Vector3f> normals;    ///< [vertices] or, where the file has none, empty
  std::vector<Eigen::Array3f> colours;     ///< [vertices], full is 1, encoded as in the file; or empty
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< indices in range
  std::vector<Eigen::Vector2f> texture_places;          ///< [vertices], u to the right, v up; or empty
  std::vector<std::uint32_t> material;                  ///< [vertices], index in range
  std::vector<ImportedMaterial> materials;
  std::vector<ImportedTexture> textures;
  std::string notes;  ///< what is not read of the file: lines, possibly repeated
};

/// How a file's vertex colours are encoded.
enum class ColourCoding { srgb, linear };
/// glTF prescribes linear; what writes colours into OBJ, PLY and OFF takes them from photographs.
ColourCoding usual_colour_coding(const fs::path& path);

/// Reads OBJ, PLY, OFF, glTF and GLB, represented by the file's name, with all their parts in place.
/// Draco-compressed glTF is read where the library was built with its decoder, as Debian's is. The library
/// (assimp) is not made for hostile files, so where files may be hostile, run.read_isolated calls it in
/// another process, with limits. run.note tells what is not read of a file.
/// Throws FormatError for what is no mesh, breaks its format, holds coordinates that are not finite or asks
/// for more than the limits; DeviceError where the file cannot be read.
ImportedMesh import_mesh(const fs::path& path, const RunContext& run);

}  // namespace refield::prt
