// SPDX-License-Identifier: Apache-2.0
#include "simulate/geometry/mesh_import.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <set>
#include <sstream>

#include "core/base/isolated.h"
#include "simulate/geometry/mesh_formats.h"

namespace refield::prt {

namespace {

constexpr std::array known_formats = {"obj", "ply", "off", "gltf", "glb"};
constexpr std::uint64_t largest_file_bytes = std::uint64_t{2} << 30;

/// What a file of this size may justify; compression by Draco included.
IsolationLimits library_limits(std::uint64_t file_bytes) {
  constexpr std::uint64_t mebibyte = std::uint64_t{1} << 20;
  return {.memory_bytes = std::min(512 * mebibyte + 500 * file_bytes, 12 * 1024 * mebibyte),
          .cpu_seconds = 3 + static_cast<int>(file_bytes / mebibyte),
          .wall_seconds = 60 + 10 * static_cast<unsigned>(file_bytes / mebibyte),
          .answer_bytes = std::min(64 * mebibyte + 100 * file_bytes, 4 * 1024 * mebibyte)};
}

// Nothing of the answer is trusted.

template <class Value>
bool take(std::string_view& bytes, std::vector<Value>& values) {
  std::uint64_t count = 0;
  if (bytes.size() < sizeof count) return false;
  std::memcpy(&count, bytes.data(), sizeof count);
  bytes.remove_prefix(sizeof count);
  if (count > bytes.size() / sizeof(Value)) return false;
  if (count == 0) return true;
  values.resize(count);
  std::memcpy(reinterpret_cast<char*>(values.data()), bytes.data(), count * sizeof(Value));
  bytes.remove_prefix(count * sizeof(Value));
  return true;
}

void require_valid(const ImportedMesh& mesh, const fs::path& path) {
  // Areas and distances squared must stay within float.
  constexpr float largest = 1e15f;
  for (std::size_t i = 0; i < mesh.positions.size(); ++i)
    if (!(mesh.positions[i].cwiseAbs().maxCoeff() <= largest) || !mesh.positions[i].allFinite())
      throw FormatError(path, "vertex ", i,
                        " has coordinates that are not finite or beyond 1e15; repair the mesh");
  for (const auto& triangle : mesh.triangles)
    for (const std::uint32_t vertex : triangle)
      if (vertex >= mesh.positions.size())
        throw FormatError(path, "a triangle names vertex ", vertex, " of ", mesh.positions.size(),
                          "; export the file again");
  for (const std::uint32_t material : mesh.material)
    if (material >= mesh.materials.size())
      throw FormatError(path, "a part names material ", material, " of ", mesh.materials.size(),
                        "; export the file again");
  for (const ImportedMaterial& material : mesh.materials)
    for (const std::int32_t texture :
         {material.texture, material.metallic_texture, material.roughness_texture})
      if (texture >= static_cast<std::int32_t>(mesh.textures.size()))
        throw FormatError(path, "a material names texture ", texture, " of ", mesh.textures.size(),
                          "; export the file again");
}

bool take(std::string_view& bytes, std::vector<ImportedTexture>& textures) {
  std::vector<std::uint64_t> lengths;
  if (!take(bytes, lengths) || lengths.size() % 2 > 0) return false;
  for (std::size_t i = 0; i < lengths.size(); i += 2) {
    ImportedTexture& texture = textures.emplace_back();
    for (std::string* text : {&texture.file, &texture.content}) {
      const std::uint64_t length = lengths[i + (text == &texture.content)];
      if (length > bytes.size()) return false;
      *text = bytes.substr(0, length);
      bytes.remove_prefix(length);
    }
  }
  return true;
}

}  // namespace

ColourCoding usual_colour_coding(const fs::path& path) {
  const std::string format = mesh_format_of(path);
  return format == "gltf" || format == "glb" ? ColourCoding::linear : ColourCoding::srgb;
}

ImportedMesh import_mesh(const fs::path& path, const RunContext& run) {
  const std::string format = mesh_format_of(path);
  if (std::ranges::find(known_formats, format) == known_formats.end())
    throw FormatError(path, "meshes are read from .obj, .ply, .off, .gltf and .glb; convert this one");
  std::error_code error;
  if (!fs::is_regular_file(path, error))
    throw DeviceError(path.string(), error ? error.value() : EINVAL, "is no mesh file");
  const std::uint64_t bytes = fs::file_size(path);
  if (bytes > largest_file_bytes) throw FormatError(path, "the file has more than 2 GiB; simplify the mesh");

  const auto answer =
      answer_of({"mesh", {path.string()}, library_limits(bytes)}, read_with_mesh_library, run);
  if (!answer)
    throw FormatError(path,
                      "the mesh library failed on this file or exceeded the limits on memory and time; "
                      "repair or simplify the mesh");
  if (answer->starts_with('E')) throw FormatError(path, "no readable mesh: " + answer->substr(1));
  std::string_view rest(*answer);
  rest.remove_prefix(1);
  ImportedMesh mesh;
  std::vector<char> notes;
  const bool complete = take(rest, mesh.positions) && take(rest, mesh.normals) && take(rest, mesh.colours) &&
                        take(rest, mesh.triangles) && take(rest, mesh.texture_places) &&
                        take(rest, mesh.material) && take(rest, mesh.materials) &&
                        take(rest, mesh.textures) && take(rest, notes);
  const auto fits = [&](std::size_t count) { return count == 0 || count == mesh.positions.size(); };
  if (!complete || !fits(mesh.normals.size()) || !fits(mesh.colours.size()) ||
      !fits(mesh.texture_places.size()) || mesh.material.size() != mesh.positions.size())
    throw FormatError(path, "the mesh library returned inconsistent data; repair the mesh");
  require_valid(mesh, path);
  std::istringstream lines(std::string(notes.begin(), notes.end()));
  std::set<std::string> told;
  for (std::string line; std::getline(lines, line);)
    if (told.insert(line).second) run.note(path, ": ", line);
  return mesh;
}

}  // namespace refield::prt
