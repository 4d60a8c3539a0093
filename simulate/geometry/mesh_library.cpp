// SPDX-License-Identifier: Apache-2.0
#include "simulate/geometry/mesh_formats.h"

#include <assimp/DefaultIOSystem.h>
#include <assimp/MemoryIOWrapper.h>
#include <assimp/importerdesc.h>
#include <assimp/scene.h>
#include <assimp/Importer.hpp>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <new>
#include <set>
#include <span>
#include <sstream>
#include <utility>

#include "core/base/json.h"
#include "core/base/number_text.h"
#include "simulate/geometry/mesh_import.h"

namespace refield::prt {

std::string mesh_format_of(const fs::path& path) {
  const std::string extension = lower_case(path.extension());
  return extension.substr(std::min<std::size_t>(extension.size(), 1));
}

bool may_be_read_for(const fs::path& mesh, const fs::path& file, std::string* refused) {
  std::error_code error;
  const fs::path real = fs::canonical(file, error);
  if (error) return false;  // is not there
  const fs::path folder = fs::canonical(mesh.has_parent_path() ? mesh.parent_path() : fs::path("."));
  const auto [ours, theirs] = std::ranges::mismatch(folder, real);
  if (ours == folder.end() && fs::is_regular_file(real, error)) return true;
  if (refused) *refused = ours == folder.end() ? "what is no regular file" : "a file outside its folder";
  return false;
}

namespace {

/// What the library opens: the mesh, as `json` has it, and files of may_be_read_for() that it names.
class FolderOnly final : public Assimp::DefaultIOSystem {
 public:
  FolderOnly(fs::path mesh, const std::string& content, std::string& refused)
      : mesh_(std::move(mesh)), content_(&content), refused_(&refused) {}

  bool Exists(const char* file) const override { return allowed(file) && DefaultIOSystem::Exists(file); }
  Assimp::IOStream* Open(const char* file, const char* mode) override {
    if (fs::path(file) == mesh_)
      return new Assimp::MemoryIOStream(reinterpret_cast<const std::uint8_t*>(content_->data()),
                                        content_->size());
    return allowed(file) ? DefaultIOSystem::Open(file, mode) : nullptr;
  }

 private:
  bool allowed(const char* file) const {
    return fs::path(file) == mesh_ || may_be_read_for(mesh_, file, refused_);
  }

  fs::path mesh_;
  const std::string* content_;
  std::string* refused_;
};

/// Leaves the library no other reader to try than those of the format that the name promises.
void keep_readers_of(Assimp::Importer& importer, const std::string& format) {
  std::vector<Assimp::BaseImporter*> others;
  for (std::size_t i = 0; i < importer.GetImporterCount(); ++i) {
    std::istringstream formats(importer.GetImporterInfo(i)->mFileExtensions);
    std::string one;
    bool wanted = false;
    while (formats >> one) wanted = wanted || one == format;
    if (!wanted) others.push_back(importer.GetImporter(i));
  }
  for (auto* reader : others) importer.UnregisterLoader(reader);
}

template <class Value>
void append(std::string& bytes, const std::vector<Value>& values) {
  const std::uint64_t count = values.size();
  bytes.append(reinterpret_cast<const char*>(&count), sizeof count);
  if (count > 0) bytes.append(reinterpret_cast<const char*>(values.data()), count * sizeof(Value));
}

void append(std::string& bytes, const std::vector<ImportedTexture>& textures) {
  std::vector<std::uint64_t> lengths;
  for (const ImportedTexture& texture : textures)
    lengths.insert(lengths.end(), {texture.file.size(), texture.content.size()});
  append(bytes, lengths);
  for (const ImportedTexture& texture : textures) bytes += texture.file + texture.content;
}

struct Parts {
  bool normals, colours, places;
};

/// A part of the scene in its place; mirrored ones are turned around, so that their outside stays outside.
void append_part(const aiMesh& part, const aiMatrix4x4& place, const Parts& have, ImportedMesh& mesh) {
  const auto first = static_cast<std::uint32_t>(mesh.positions.size());
  const aiMatrix3x3 turn(place), of_normals = aiMatrix3x3(turn).Inverse().Transpose();
  const bool mirrored = turn.Determinant() < 0.0f;
  for (unsigned v = 0; v < part.mNumVertices; ++v) {
    const aiVector3D position = place * part.mVertices[v];
    mesh.positions.emplace_back(position.x, position.y, position.z);
    if (have.normals) {
      const aiVector3D normal = (of_normals * part.mNormals[v]).NormalizeSafe();
      mesh.normals.emplace_back(normal.x, normal.y, normal.z);
    }
    mesh.material.push_back(part.mMaterialIndex);
    const aiVector3D at = have.places && part.HasTextureCoords(0) ? part.mTextureCoords[0][v] : aiVector3D();
    if (have.places) mesh.texture_places.emplace_back(at.x, at.y);
    const aiColor4D colour = part.HasVertexColors(0) ? part.mColors[0][v] : aiColor4D(1, 1, 1, 1);
    if (have.colours) mesh.colours.emplace_back(colour.r, colour.g, colour.b);
  }
  for (const aiFace& face : std::span(part.mFaces, part.mNumFaces)) {
    if (face.mNumIndices < 3) continue;  // points and lines
    std::vector<std::uint32_t> corners;
    for (unsigned i = 0; i < face.mNumIndices; ++i)
      corners.push_back(first + std::min(face.mIndices[i], unsigned{1} << 31));
    if (mirrored) std::ranges::reverse(corners);
    append_polygon(std::move(corners), mesh);
  }
}

void append_node(const aiScene& scene, const aiNode& node, const aiMatrix4x4& above, const Parts& have,
                 ImportedMesh& mesh) {
  const aiMatrix4x4 place = above * node.mTransformation;
  for (const unsigned part : std::span(node.mMeshes, node.mNumMeshes))
    append_part(*scene.mMeshes[part], place, have, mesh);
  for (const aiNode* child : std::span(node.mChildren, node.mNumChildren))
    append_node(scene, *child, place, have, mesh);
}

// ---- glTF: the library reads the geometry, since it has the decoder of Draco; the rest is as the JSON says

/// What stands under a key, or an empty object.
const Json& child(const Json& object, const char* key) {
  static const Json none = Json::object();
  return object.contains(key) ? object.at(key) : none;
}

/// The JSON of a file, and of a GLB all after the chunk of JSON.
struct Gltf {
  Json json;
  std::string rest;
  bool binary = false;

  std::string content() const {
    std::string text = json_text(json);
    if (!binary) return text;
    text.resize((text.size() + 3) / 4 * 4, ' ');
    std::string bytes = "glTF";
    for (const std::size_t number : {std::size_t{2}, 20 + text.size() + rest.size(), text.size()})
      for (int shift = 0; shift < 32; shift += 8) bytes += static_cast<char>(number >> shift & 255);
    return bytes + "JSON" + text + rest;
  }
};

Gltf parse_gltf(const std::string& bytes, bool binary) {
  if (bytes.empty()) throw MeshFault("the file is empty");
  if (!binary && bytes.starts_with("glTF")) throw MeshFault("it is a GLB file; name it .glb");
  if (!binary) return {json_from_text(bytes), {}, false};
  const auto word = [&](std::size_t at) {
    std::uint32_t number = 0;
    std::memcpy(&number, bytes.data() + at, sizeof number);
    return number;
  };
  if (bytes.size() < 20 || !bytes.starts_with("glTF") || word(4) != 2)
    throw MeshFault("it is no GLB file of version 2");
  if (word(8) != bytes.size() || word(12) > bytes.size() - 20)
    throw MeshFault("its header promises another size; it is cut off or damaged");
  return {json_from_text(bytes.substr(20, word(12))), bytes.substr(20 + word(12)), true};
}

/// The library looks for files under names as they stand, and fails on skins without inverse bind matrices.
void prepare_for_library(Json& gltf, const fs::path& path) {
  const auto each = [&](const char* kind) -> Json {
    return gltf.contains(kind) ? gltf[kind] : Json::array();
  };
  for (const char* kind : {"buffers", "images"})
    for (Json items = each(kind); Json & item : items) {
      const std::string uri = item.value("uri", "");
      if (uri.starts_with("data:") || fs::exists(path.parent_path() / uri)) continue;
      std::string name;
      for (std::size_t i = 0; i < uri.size(); ++i) {
        int code = 0;
        const bool escaped = uri[i] == '%' && i + 2 < uri.size() &&
                             std::from_chars(&uri[i + 1], &uri[i + 1] + 2, code, 16).ptr == &uri[i + 1] + 2;
        name += escaped ? static_cast<char>(code) : uri[i];
        if (escaped) i += 2;
      }
      gltf[kind][&item - &items[0]]["uri"] = name;
    }
  gltf.erase("skins");
  gltf.erase("animations");
  if (gltf.contains("nodes"))
    for (Json& node : gltf["nodes"]) node.erase("skin");
}

const std::set<std::string>& supported_extensions() {
  static const std::set<std::string> names = {"KHR_draco_mesh_compression", "KHR_texture_transform",
                                              "KHR_materials_unlit", "KHR_lights_punctual"};
  return names;
}

/// As messages name it: the file may say anything.
std::string extension_name(const std::string& name) {
  const bool plain = name.size() < 64 &&
                     std::ranges::all_of(name, [](unsigned char c) { return std::isalnum(c) || c == '_'; });
  return plain ? name : "of an odd name";
}

/// Extensions in any part, whether or not the file declares them.
void find_extensions(const Json& part, std::set<std::string>& names) {
  for (const auto& [key, value] : part.items()) {
    if (part.is_object() && key == "extensions" && value.is_object())
      for (const auto& extension : value.items()) names.insert(extension.key());
    if (value.is_structured()) find_extensions(value, names);
  }
}

/// Names what the file uses without requiring it, and is not read.
std::string unread_extensions(const Json& gltf) {
  std::set<std::string> names, unread;
  find_extensions(gltf, names);
  for (const std::string& name : gltf.value("extensionsUsed", std::vector<std::string>{})) names.insert(name);
  for (const std::string& name : names)
    if (!supported_extensions().contains(name)) unread.insert(extension_name(name));
  std::string list;
  for (const std::string& name : unread) list += (list.empty() ? "" : ", ") + name;
  return list.empty() ? "" : "glTF extensions are ignored, which may change the look: " + list + "\n";
}

void require_supported(const Gltf& file) {
  const Json& gltf = file.json;
  const Json& asset = child(gltf, "asset");
  if (!asset.value("version", "").starts_with("2.") || asset.value("minVersion", "2.0") != "2.0")
    throw MeshFault("it is not of glTF 2.0, which its asset must state; export it as glTF 2.0");
  const Json& buffers = child(gltf, "buffers");
  if (file.binary && !buffers.empty() && buffers.at(0).contains("uri"))
    throw MeshFault(
        "its first buffer is another file, which GLB files are not read with; export it as .gltf");
  for (const std::string& name : gltf.value("extensionsRequired", std::vector<std::string>{}))
    if (!supported_extensions().contains(name))
      throw MeshFault("it requires the glTF extension ", extension_name(name),
                      ", which is not supported; export the mesh without it");
}

std::uint64_t triangles_of(const Json& gltf, const Json& primitive) {
  const Json& attributes = primitive.at("attributes");
  const auto accessor = [&](const Json& index) -> const Json& {
    return gltf.at("accessors").at(index.get<std::size_t>());
  };
  constexpr int of_floats = 5126;
  for (const char* name : {"POSITION", "NORMAL", "TEXCOORD_0"})
    if (attributes.contains(name) && accessor(attributes[name]).value("componentType", 0) != of_floats)
      throw MeshFault("its attribute ", name, " is stored as integers (quantized); export it as floats");
  if (!attributes.contains("POSITION")) return 0;
  const Json& corners = primitive.contains("indices") ? primitive["indices"] : attributes["POSITION"];
  const auto count = accessor(corners).at("count").get<std::uint64_t>();
  const int mode = primitive.value("mode", 4);  // triangles; 5 and 6 are strips and fans
  return mode == 4 ? count / 3 : mode == 5 || mode == 6 ? count - std::min<std::uint64_t>(count, 2) : 0;
}

/// What the JSON promises in some nodes and below, each mesh as often as it is placed. Notes what is not
/// read.
std::uint64_t triangles_below(const Json& gltf, const Json& nodes, std::set<std::size_t>& seen,
                              std::string& notes) {
  std::uint64_t triangles = 0;
  for (const Json& index : nodes) {
    const auto number = index.get<std::size_t>();
    if (!seen.insert(number).second)
      throw MeshFault("one of its nodes has two parents; export the file again");
    const Json& node = gltf.at("nodes").at(number);
    triangles += triangles_below(gltf, child(node, "children"), seen, notes);
    if (!node.contains("mesh")) continue;
    const Json& mesh = gltf.at("meshes").at(node.at("mesh").get<std::size_t>());
    for (const Json& primitive : mesh.at("primitives")) triangles += triangles_of(gltf, primitive);
    const auto weights = (node.contains("weights") ? node : mesh).value("weights", std::vector<double>{});
    if (std::ranges::any_of(weights, [](double weight) { return weight != 0.0; }))
      notes += "morph targets are ignored\n";
    if (node.contains("skin"))
      notes += "skins are ignored: the mesh is shown as it is stored, in its node's place\n";
  }
  return triangles;
}

std::int32_t texture_of(const Json& gltf, const Json& info, const aiScene& scene, const fs::path& path,
                        ImportedMesh& mesh) {
  const Json& texture = gltf.at("textures").at(info.at("index").get<std::size_t>());
  if (!texture.contains("source")) return -1;  // an image of an extension
  const Json &images = gltf.at("images"), &image = images.at(texture["source"].get<std::size_t>());
  const auto is_inside = [](const Json& one) {
    return one.contains("bufferView") || one.value("uri", "").starts_with("data:");
  };
  if (!is_inside(image)) return texture_beside(path, image.value("uri", ""), mesh);
  std::ptrdiff_t number = 0;  // as the library counts them
  for (const Json* one = &images[0]; one != &image; ++one) number += is_inside(*one);
  if (number >= scene.mNumTextures || scene.mTextures[number]->mHeight > 0) return -1;
  const aiTexture& inside = *scene.mTextures[number];
  const std::string content(reinterpret_cast<const char*>(inside.pcData), inside.mWidth);
  const auto known = std::ranges::find(mesh.textures, content, &ImportedTexture::content);
  const auto index = static_cast<std::int32_t>(known - mesh.textures.begin());
  if (known == mesh.textures.end()) mesh.textures.push_back({{}, content});
  return index;
}

std::uint32_t ignored_parts_of(const Json& material) {
  std::uint32_t ignored = 0;
  for (const auto& extension : child(material, "extensions").items()) {
    const std::string& name = extension.key();
    if (name == "KHR_materials_transmission")
      ignored |= ignored_transparency;
    else if (name.starts_with("KHR_materials_") && name != "KHR_materials_unlit")
      ignored |= ignored_layers;
  }
  if (material.value("doubleSided", false)) ignored |= ignored_back;
  if (material.contains("normalTexture")) ignored |= ignored_relief;
  for (const float factor : material.value("emissiveFactor", std::array{0.0f, 0.0f, 0.0f}))
    if (factor > 0.0f) ignored |= ignored_emission;
  const Json& pbr = child(material, "pbrMetallicRoughness");
  const bool has_alpha = pbr.contains("baseColorTexture") ||
                         pbr.value("baseColorFactor", std::array{1.0f, 1.0f, 1.0f, 1.0f})[3] < 1.0f;
  if (has_alpha && material.value("alphaMode", "OPAQUE") != "OPAQUE") ignored |= ignored_transparency;
  return ignored;
}

/// KHR_texture_transform. Its rotation turns counter-clockwise in an image whose rows go down, as three.js,
/// Babylon and Blender have it.
TexturePlacement placement_of(const Json& transform) {
  const auto scale = transform.value("scale", std::array{1.0f, 1.0f});
  const auto offset = transform.value("offset", std::array{0.0f, 0.0f});
  const float turn = transform.value("rotation", 0.0f);
  const Eigen::Matrix2f rotation{{std::cos(turn), std::sin(turn)}, {-std::sin(turn), std::cos(turn)}};
  return {rotation * Eigen::Vector2f(scale[0], scale[1]).asDiagonal(), {offset[0], offset[1]}};
}

ImportedMaterial material_of(const Json& gltf, const Json& material, const aiScene& scene,
                             const fs::path& path, TexturePlacement& placement, ImportedMesh& mesh) {
  ImportedMaterial result{.is_of_the_file = 1};
  result.ignored = ignored_parts_of(material);
  const Json& pbr = child(material, "pbrMetallicRoughness");
  const auto factor = pbr.value("baseColorFactor", std::array{1.0f, 1.0f, 1.0f, 1.0f});
  std::copy_n(factor.begin(), 3, result.base_colour.begin());
  std::vector<TexturePlacement> placements;
  const auto read_texture = [&](const char* key, std::int32_t& texture) {
    const Json& info = child(pbr, key);
    if (info.empty()) return;
    const Json& transform = child(child(info, "extensions"), "KHR_texture_transform");
    placements.push_back(placement_of(transform));
    // One placement is applied to all textures of a material.
    if (transform.value("texCoord", info.value("texCoord", 0)) == 0 &&
        placements.back() == placements.front())
      texture = texture_of(gltf, info, scene, path, mesh);
    if (texture < 0) result.ignored |= ignored_texture;
    const Json& sampler = child(gltf.at("textures").at(info.at("index").get<std::size_t>()), "sampler");
    constexpr int repeats = 10497;
    for (const char* axis : {"wrapS", "wrapT"})
      if (sampler.is_number() &&
          gltf.at("samplers").at(sampler.get<std::size_t>()).value(axis, repeats) != repeats)
        mesh.notes += "its textures repeat, though their samplers clamp or mirror them\n";
  };
  read_texture("baseColorTexture", result.texture);
  // Unlit materials, which scans have, are matt: their colour is all that was measured.
  if (!child(material, "extensions").contains("KHR_materials_unlit")) {
    result.specular.fill(dielectric_reflectance);
    result.metallic = pbr.value("metallicFactor", 1.0f);
    result.roughness = pbr.value("roughnessFactor", 1.0f);
    read_texture("metallicRoughnessTexture", result.metallic_texture);
    result.roughness_texture = result.metallic_texture;
  }
  note_excess(result);
  if (!placements.empty()) placement = placements.front();
  return result;
}

/// What the library says may quote the file, so only the kind of fault is passed on.
std::string kind_of_fault(const std::string& error) {
  const auto speaks_of = [&](const char* word) { return error.find(word) != std::string::npos; };
  if (speaks_of("bad_alloc")) throw std::bad_alloc();
  if (speaks_of("Draco")) return "its Draco data are damaged, or this build of assimp lacks the decoder";
  return speaks_of("ould not open") ? "a file that it refers to cannot be opened"
                                    : "its content breaks the format";
}

/// Materials, and texture coordinates as they place them.
void append_materials(const Json& gltf, const aiScene& scene, const fs::path& path, ImportedMesh& mesh) {
  std::vector<TexturePlacement> placements;
  for (const Json& material : child(gltf, "materials"))
    mesh.materials.push_back(material_of(gltf, material, scene, path, placements.emplace_back(), mesh));
  mesh.materials.resize(scene.mNumMaterials);  // the library adds one for parts without
  placements.resize(mesh.materials.size());
  for (std::size_t v = 0; v < mesh.texture_places.size(); ++v) {
    const TexturePlacement& placement = placements.at(mesh.material[v]);
    Eigen::Vector2f& place = mesh.texture_places[v];
    place.y() = 1.0f - place.y();  // the library turned it upwards
    place = placement.turn * place + placement.offset;
    place.y() = 1.0f - place.y();
  }
}

ImportedMesh read_gltf(const std::string& bytes, const fs::path& path) {
  Gltf gltf = parse_gltf(bytes, mesh_format_of(path) == "glb");
  require_supported(gltf);
  ImportedMesh mesh;
  mesh.notes = unread_extensions(gltf.json);
  const Json& scenes = child(gltf.json, "scenes");
  if (scenes.empty()) throw MeshFault("it has no scene, so that nothing is shown; export it with one");
  const Json& roots = child(scenes.at(gltf.json.value("scene", std::size_t{0})), "nodes");
  std::set<std::size_t> seen;
  const std::uint64_t promised = triangles_below(gltf.json, roots, seen, mesh.notes);
  prepare_for_library(gltf.json, path);

  Assimp::Importer importer;
  keep_readers_of(importer, mesh_format_of(path));
  std::string refused;
  const std::string content = gltf.content();
  importer.SetIOHandler(new FolderOnly(path, content, refused));  // owned by the importer
  const aiScene* scene = importer.ReadFile(path, 0);
  if (!refused.empty())
    throw MeshFault("it refers to ", refused, "; put all that belongs to the mesh into one folder");
  if (scene == nullptr) throw MeshFault(kind_of_fault(importer.GetErrorString()));
  const std::span parts(scene->mMeshes, scene->mNumMeshes);
  const Parts have{std::ranges::all_of(parts, [](const aiMesh* part) { return part->HasNormals(); }),
                   std::ranges::any_of(parts, [](const aiMesh* part) { return part->HasVertexColors(0); }),
                   std::ranges::any_of(parts, [](const aiMesh* part) { return part->HasTextureCoords(0); })};
  append_node(*scene, *scene->mRootNode, aiMatrix4x4(), have, mesh);
  // The library leaves out triangles whose indices are out of range.
  if (mesh.triangles.size() != promised)
    throw MeshFault("it promises ", promised, " triangles, of which ", mesh.triangles.size(),
                    " can be read: an index is out of range; export the file again");
  append_materials(gltf.json, *scene, path, mesh);
  return mesh;
}

ImportedMesh read_any(const fs::path& path) {
  std::ifstream stream(path, std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(stream), {}}, format = mesh_format_of(path);
  if (format == "ply") return read_ply(bytes, path);
  if (format == "off") return read_off(bytes);
  if (format == "obj") return read_obj(bytes, path);
  try {
    return read_gltf(bytes, path);
  } catch (const Json::exception&) {
    throw MeshFault("its JSON is damaged, or lacks what glTF 2.0 requires");
  }
}

}  // namespace

std::string read_with_mesh_library(const std::vector<std::string>& arguments) {
  try {
    const ImportedMesh mesh = read_any(arguments.at(0));
    std::string answer = "M";
    append(answer, mesh.positions);
    append(answer, mesh.normals);
    append(answer, mesh.colours);
    append(answer, mesh.triangles);
    append(answer, mesh.texture_places);
    append(answer, mesh.material);
    append(answer, mesh.materials);
    append(answer, mesh.textures);
    append(answer, std::vector<char>(mesh.notes.begin(), mesh.notes.end()));
    return answer;
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const MeshFault& fault) {
    return "E" + std::string(fault.what());
  } catch (const std::exception& error) {
    return "E" + kind_of_fault(error.what());
  }
}

}  // namespace refield::prt
