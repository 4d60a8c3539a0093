// SPDX-License-Identifier: Apache-2.0
#include "relight/mesh/baked_mesh.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include "core/base/files.h"
#include "core/base/json.h"

namespace refield {

namespace {

static_assert(std::endian::native == std::endian::little, "glTF stores the lowest byte first");

constexpr int float_type = 5126, index_type = 5125;         // of accessors
constexpr int vertex_buffer = 34962, index_buffer = 34963;  // targets of buffer views

/// The buffer of a file and what lies in it.
struct Buffer {
  std::string bytes;
  Json views = Json::array(), accessors = Json::array();

  /// The number of the accessor.
  template <class Value>
  int add(const std::vector<Value>& values, std::size_t count, const char* type, int component, int target) {
    views.push_back({{"buffer", 0},
                     {"byteOffset", bytes.size()},
                     {"byteLength", values.size() * sizeof(Value)},
                     {"target", target}});
    accessors.push_back(
        {{"bufferView", views.size() - 1}, {"componentType", component}, {"count", count}, {"type", type}});
    bytes.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(Value));
    return static_cast<int>(accessors.size()) - 1;
  }
};

std::vector<float> turned(const std::vector<Eigen::Vector3f>& vectors) {
  std::vector<float> values;
  for (const Eigen::Vector3f& vector : vectors)
    values.insert(values.end(), {vector.x(), vector.y(), -vector.z()});
  return values;
}

void append_word(std::string& bytes, std::size_t word) {
  const auto value = static_cast<std::uint32_t>(word);
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

void append_chunk(std::string& bytes, const char* kind, std::string content, char filling) {
  content.resize((content.size() + 3) / 4 * 4, filling);
  append_word(bytes, content.size());
  bytes.append(kind, 4);
  bytes += content;
}

}  // namespace

void write_baked_mesh(const std::filesystem::path& path, const Mesh& mesh,
                      std::span<const Eigen::Array3f> colours) {
  const std::size_t vertices = mesh.positions.size();
  std::vector<float> colour_values;
  for (const Eigen::Array3f& colour : colours)
    for (const float value : colour) colour_values.push_back(std::min(std::max(value, 0.0f), 1.0f));
  std::vector<std::uint32_t> corners;
  for (const auto& [a, b, c] : mesh.triangles) corners.insert(corners.end(), {a, c, b});
  Eigen::AlignedBox3f bounds;
  for (const Eigen::Vector3f& position : mesh.positions)
    bounds.extend(Eigen::Vector3f(position.x(), position.y(), -position.z()));

  Buffer buffer;
  const int positions = buffer.add(turned(mesh.positions), vertices, "VEC3", float_type, vertex_buffer);
  for (const auto& [name, corner] : {std::pair{"min", bounds.min()}, {"max", bounds.max()}})
    buffer.accessors[positions][name] = {corner.x(), corner.y(), corner.z()};
  const int normals = buffer.add(turned(mesh.normals), vertices, "VEC3", float_type, vertex_buffer);
  const int colour = buffer.add(colour_values, vertices, "VEC3", float_type, vertex_buffer);
  const int indices = buffer.add(corners, corners.size(), "SCALAR", index_type, index_buffer);
  const auto list_of = [](Json value) { return Json::array({std::move(value)}); };
  const Json primitive{{"attributes", {{"POSITION", positions}, {"NORMAL", normals}, {"COLOR_0", colour}}},
                       {"indices", indices},
                       {"material", 0}};
  const Json material{{"name", "baked"},
                      {"pbrMetallicRoughness", {{"metallicFactor", 0.0}, {"roughnessFactor", 1.0}}},
                      {"extensions", {{"KHR_materials_unlit", Json::object()}}}};
  const Json gltf{{"asset", {{"version", "2.0"}, {"generator", "refield"}}},
                  {"extensionsUsed", list_of("KHR_materials_unlit")},
                  {"scene", 0},
                  {"scenes", list_of({{"nodes", list_of(0)}})},
                  {"nodes", list_of({{"mesh", 0}})},
                  {"meshes", list_of({{"primitives", list_of(primitive)}})},
                  {"materials", list_of(material)},
                  {"accessors", buffer.accessors},
                  {"bufferViews", buffer.views},
                  {"buffers", list_of({{"byteLength", buffer.bytes.size()}})}};

  std::string chunks;
  append_chunk(chunks, "JSON", json_text(gltf), ' ');
  append_chunk(chunks, "BIN\0", buffer.bytes, '\0');
  std::string file = "glTF";
  append_word(file, 2);
  append_word(file, 12 + chunks.size());
  write_text_atomically(path, file + chunks);
}

}  // namespace refield
