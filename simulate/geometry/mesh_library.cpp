// SPDX-License-Identifier: Apache-2.0
#include "simulate/geometry/mesh_library.h"

#include <assimp/DefaultIOSystem.h>
#include <assimp/importerdesc.h>
#include <assimp/material.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>
#include <assimp/DefaultLogger.hpp>
#include <assimp/Importer.hpp>
#include <assimp/LogStream.hpp>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <new>
#include <span>
#include <sstream>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "simulate/geometry/mesh_import.h"

namespace refield::prt {

namespace fs = std::filesystem;

std::string mesh_format_of(const fs::path& path) {
  std::string format = path.extension().string();
  if (!format.empty()) format.erase(0, 1);
  for (char& letter : format) letter = static_cast<char>(std::tolower(static_cast<unsigned char>(letter)));
  return format;
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

/// Some readers mend wrong indices and only say so in the log.
class WrongIndexListener final : public Assimp::LogStream {
 public:
  explicit WrongIndexListener(bool& heard) : heard_(&heard) {}
  void write(const char* message) override {
    *heard_ = *heard_ || std::string_view(message).find("out of range") != std::string_view::npos;
  }

 private:
  bool* heard_;
};

/// The library's log, of the whole process, with such a listener alone.
class HeardLog {
 public:
  explicit HeardLog(bool& wrong_index) {
    Assimp::DefaultLogger::create("", Assimp::Logger::NORMAL, 0)
        ->attachStream(new WrongIndexListener(wrong_index), Assimp::Logger::Err);  // owned by the logger
  }
  ~HeardLog() { Assimp::DefaultLogger::kill(); }
  HeardLog(const HeardLog&) = delete;
  HeardLog& operator=(const HeardLog&) = delete;
};

/// Why a mesh is refused, in words that are not the file's.
struct MeshFault : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// A mesh may name other files: materials, buffers. Only those of may_be_read_for() are opened.
class FolderOnly final : public Assimp::DefaultIOSystem {
 public:
  FolderOnly(fs::path mesh, std::string& refused) : mesh_(std::move(mesh)), refused_(&refused) {}

  bool Exists(const char* file) const override { return allowed(file) && DefaultIOSystem::Exists(file); }
  Assimp::IOStream* Open(const char* file, const char* mode) override {
    return allowed(file) ? DefaultIOSystem::Open(file, mode) : nullptr;
  }

 private:
  bool allowed(const char* file) const {
    return fs::path(file) == mesh_ || may_be_read_for(mesh_, file, refused_);
  }

  fs::path mesh_;
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

void append_part(const aiMesh& part, bool normals, bool colours, bool places, ImportedMesh& mesh) {
  const auto first = static_cast<std::uint32_t>(mesh.positions.size());
  for (unsigned v = 0; v < part.mNumVertices; ++v) {
    mesh.positions.emplace_back(part.mVertices[v].x, part.mVertices[v].y, part.mVertices[v].z);
    if (normals) mesh.normals.emplace_back(part.mNormals[v].x, part.mNormals[v].y, part.mNormals[v].z);
    mesh.material.push_back(part.mMaterialIndex);
    if (places && part.HasTextureCoords(0))
      mesh.texture_places.emplace_back(part.mTextureCoords[0][v].x, part.mTextureCoords[0][v].y);
    else if (places)
      mesh.texture_places.emplace_back(0.0f, 0.0f);
    if (!colours) continue;
    if (!part.HasVertexColors(0))
      mesh.colours.push_back(Eigen::Array3f::Ones());
    else
      mesh.colours.emplace_back(part.mColors[0][v].r, part.mColors[0][v].g, part.mColors[0][v].b);
  }
  for (const aiFace& face : std::span(part.mFaces, part.mNumFaces)) {
    if (face.mNumIndices != 3) continue;  // points and lines
    std::array<std::uint32_t, 3> triangle{};
    for (std::size_t i = 0; i < 3; ++i) {
      if (face.mIndices[i] >= part.mNumVertices)
        throw MeshFault("a triangle names vertex " + std::to_string(face.mIndices[i]) + " of " +
                        std::to_string(part.mNumVertices) + "; export the file again");
      triangle[i] = first + face.mIndices[i];
    }
    mesh.triangles.push_back(triangle);
  }
}

/// What the library says may quote the file, so only the kind of fault is passed on.
std::string kind_of_fault(const std::string& error) {
  const auto speaks_of = [&](const char* word) { return error.find(word) != std::string::npos; };
  if (speaks_of("bad_alloc")) throw std::bad_alloc();
  if (speaks_of("raco"))
    return "this build of assimp lacks the Draco decoder: export the mesh without compression";
  for (const auto& [word, kind] : {std::pair{"mpty", "the file is empty"},
                                   {"too small", "the file is too short"},
                                   {"ndex", "an index is out of range"},
                                   {"JSON", "its JSON is damaged"},
                                   {"open", "a file that it refers to cannot be opened"},
                                   {"No suitable reader", "its content does not match its file extension"}})
    if (speaks_of(word)) return kind;
  return "its content breaks the format";
}

float number_of(const aiMaterial& material, const char* key, unsigned type, unsigned index, float standard) {
  float value = standard;
  return material.Get(key, type, index, value) == AI_SUCCESS ? value : standard;
}

/// Whether a material says more than the one that the library makes up for parts without.
bool is_of_the_file(const aiMaterial& material) {
  for (int type = aiTextureType_NONE + 1; type <= AI_TEXTURE_TYPE_MAX; ++type)
    if (material.GetTextureCount(static_cast<aiTextureType>(type)) > 0) return true;
  aiColor4D colour;
  if (material.Get(AI_MATKEY_BASE_COLOR, colour) == AI_SUCCESS &&
      (colour.r != 1.0f || colour.g != 1.0f || colour.b != 1.0f))
    return true;
  if (number_of(material, AI_MATKEY_METALLIC_FACTOR, 1.0f) != 1.0f ||
      number_of(material, AI_MATKEY_ROUGHNESS_FACTOR, 1.0f) != 1.0f)
    return true;
  aiString name;
  return material.Get(AI_MATKEY_NAME, name) == AI_SUCCESS && name.length > 0 &&
         std::string_view(name.C_Str()) != AI_DEFAULT_MATERIAL_NAME;
}

/// The texture's index in the mesh; −1 where it is not read.
std::int32_t texture_of(const aiScene& scene, const fs::path& path, const aiString& name,
                        ImportedMesh& mesh) {
  ImportedTexture texture;
  if (const aiTexture* inside = scene.GetEmbeddedTexture(name.C_Str())) {
    if (inside->mHeight > 0) return -1;  // no image file
    texture.content.assign(reinterpret_cast<const char*>(inside->pcData), inside->mWidth);
  } else {
    std::string text = name.C_Str();
    std::ranges::replace(text, '\\', '/');  // of Windows
    fs::path file = path.parent_path() / text;
    // Exporters write where the image was on their own machine.
    if (!may_be_read_for(path, file)) file = path.parent_path() / fs::path(text).filename();
    if (!may_be_read_for(path, file)) return -1;
    texture.file = file;
  }
  const auto known = std::ranges::find_if(mesh.textures, [&](const ImportedTexture& other) {
    return other.file == texture.file && other.content == texture.content;
  });
  const auto index = static_cast<std::int32_t>(known - mesh.textures.begin());
  if (known == mesh.textures.end()) mesh.textures.push_back(std::move(texture));
  return index;
}

std::uint32_t ignored_parts_of(const aiMaterial& material) {
  const auto has_texture = [&](std::initializer_list<aiTextureType> types) {
    return std::ranges::any_of(types, [&](aiTextureType type) { return material.GetTextureCount(type) > 0; });
  };
  const auto number = [&](const char* key, unsigned type, unsigned index, float standard) {
    return number_of(material, key, type, index, standard);
  };
  const auto shines = [&](const char* key, unsigned type, unsigned index) {
    aiColor4D colour;
    return material.Get(key, type, index, colour) == AI_SUCCESS && colour.r + colour.g + colour.b > 0.0f;
  };
  std::uint32_t ignored = 0;
  float glossiness = 0.0f;
  if (number(AI_MATKEY_CLEARCOAT_FACTOR, 0.0f) > 0.0f || shines(AI_MATKEY_SHEEN_COLOR_FACTOR) ||
      material.Get(AI_MATKEY_GLOSSINESS_FACTOR, glossiness) == AI_SUCCESS ||
      has_texture({aiTextureType_SPECULAR, aiTextureType_SHININESS}))
    ignored |= ignored_layers;
  if (has_texture({aiTextureType_NORMALS, aiTextureType_HEIGHT, aiTextureType_DISPLACEMENT,
                   aiTextureType_NORMAL_CAMERA}))
    ignored |= ignored_relief;
  if (shines(AI_MATKEY_COLOR_EMISSIVE) || has_texture({aiTextureType_EMISSIVE, aiTextureType_EMISSION_COLOR}))
    ignored |= ignored_emission;
  if (number(AI_MATKEY_OPACITY, 1.0f) < 1.0f || number(AI_MATKEY_TRANSMISSION_FACTOR, 0.0f) > 0.0f ||
      has_texture({aiTextureType_OPACITY}))
    ignored |= ignored_transparency;
  return ignored;
}

/// glTF and the PBR extension of MTL (Pm, Pr) have metallic-roughness. Else highlights are those of MTL: Ks
/// is the reflectance beside Kd, Ns the exponent n of Blinn's half-vector lobe, as wide as a GGX lobe of α² =
/// 2/(n + 2) (Walter et al. 2007, section 5.2). Unlit glTF materials, which scans have, are matt: their
/// colour is all that was measured.
void read_lobe(const aiMaterial& material, bool is_gltf, ImportedMaterial& result) {
  constexpr float dielectric = 0.04f;  // index of refraction 1.5: glTF 2.0, appendix B
  int shading = 0;
  if (is_gltf && material.Get(AI_MATKEY_SHADING_MODEL, shading) == AI_SUCCESS &&
      shading == aiShadingMode_Unlit)
    return;
  const bool metallic = material.Get(AI_MATKEY_METALLIC_FACTOR, result.metallic) == AI_SUCCESS;
  const float exponent = number_of(material, AI_MATKEY_SHININESS, 0.0f);
  result.roughness = std::pow(2.0f / (std::max(exponent, 0.0f) + 2.0f), 0.25f);
  const bool rough = material.Get(AI_MATKEY_ROUGHNESS_FACTOR, result.roughness) == AI_SUCCESS;
  aiColor4D specular;
  if (is_gltf || metallic || rough) {
    result.specular = {dielectric, dielectric, dielectric};
  } else if (material.Get(AI_MATKEY_COLOR_SPECULAR, specular) == AI_SUCCESS) {
    result.specular = {specular.r, specular.g, specular.b};
    // Kd and Ks add up, where the diffuse part of metallic-roughness is multiplied by what is left.
    for (std::size_t c = 0; c < 3; ++c)
      result.base_colour[c] /= std::clamp(1.0f - result.specular[c], 1e-3f, 1.0f);
  }
}

ImportedMaterial material_of(const aiScene& scene, const aiMaterial& material, const fs::path& path,
                             ImportedMesh& mesh) {
  ImportedMaterial result;
  if (!is_of_the_file(material)) return result;
  result.is_of_the_file = 1;
  // Of these formats the library makes materials up.
  const std::string format = mesh_format_of(path);
  const bool made_up = format == "ply" || format == "off";
  result.ignored = ignored_parts_of(material);
  aiColor4D colour;
  if (!made_up && (material.Get(AI_MATKEY_BASE_COLOR, colour) == AI_SUCCESS ||
                   material.Get(AI_MATKEY_COLOR_DIFFUSE, colour) == AI_SUCCESS))
    result.base_colour = {colour.r, colour.g, colour.b};
  const auto exceeds = [](float factor) { return !(factor >= 0.0f && factor <= 1.0f); };
  const auto read_texture = [&](std::initializer_list<aiTextureType> types, std::int32_t& texture) {
    for (const aiTextureType type : types) {
      if (material.GetTextureCount(type) == 0) continue;
      aiString name;
      unsigned coordinates = 0;
      if (material.GetTexture(type, 0, &name, nullptr, &coordinates) == AI_SUCCESS && coordinates == 0)
        texture = texture_of(scene, path, name, mesh);
      if (texture < 0) result.ignored |= ignored_texture;
      return;
    }
  };
  read_texture({aiTextureType_BASE_COLOR, aiTextureType_DIFFUSE}, result.texture);
  read_texture({aiTextureType_METALNESS}, result.metallic_texture);
  read_texture({aiTextureType_DIFFUSE_ROUGHNESS}, result.roughness_texture);
  // Exporters that let the texture say everything write black.
  if (result.texture >= 0 && result.base_colour == std::array{0.0f, 0.0f, 0.0f})
    result.base_colour = {1.0f, 1.0f, 1.0f};
  bool excess = std::ranges::any_of(result.base_colour, exceeds);
  if (!made_up) read_lobe(material, format == "gltf" || format == "glb", result);
  excess = excess || std::ranges::any_of(result.specular, exceeds) || exceeds(result.metallic) ||
           exceeds(result.roughness);
  if (excess) result.ignored |= ignored_excess;
  return result;
}

ImportedMesh run_library(const fs::path& path) {
  bool wrong_index = false;
  const HeardLog log(wrong_index);
  Assimp::Importer importer;
  keep_readers_of(importer, mesh_format_of(path));
  std::string refused;
  importer.SetIOHandler(new FolderOnly(path, refused));  // owned by the importer
  const aiScene* scene = importer.ReadFile(path, aiProcess_Triangulate | aiProcess_PreTransformVertices);
  if (!refused.empty())
    throw MeshFault("it refers to " + refused + "; put all that belongs to the mesh into one folder");
  if (scene == nullptr) throw MeshFault(kind_of_fault(importer.GetErrorString()));
  if (wrong_index)
    throw MeshFault("a triangle refers to a vertex that does not exist; export the file again");
  const std::span parts(scene->mMeshes, scene->mNumMeshes);
  const bool normals = std::ranges::all_of(parts, [](const aiMesh* part) { return part->HasNormals(); });
  const bool colours =
      std::ranges::any_of(parts, [](const aiMesh* part) { return part->HasVertexColors(0); });
  ImportedMesh mesh;
  const bool places =
      std::ranges::any_of(parts, [](const aiMesh* part) { return part->HasTextureCoords(0); });
  for (const aiMesh* part : parts) append_part(*part, normals, colours, places, mesh);
  for (const aiMaterial* material : std::span(scene->mMaterials, scene->mNumMaterials))
    mesh.materials.push_back(material_of(*scene, *material, path, mesh));
  return mesh;
}

}  // namespace

std::string read_with_mesh_library(const std::vector<std::string>& arguments) {
  try {
    const ImportedMesh mesh = run_library(arguments.at(0));
    std::string answer = "M";
    append(answer, mesh.positions);
    append(answer, mesh.normals);
    append(answer, mesh.colours);
    append(answer, mesh.triangles);
    append(answer, mesh.texture_places);
    append(answer, mesh.material);
    append(answer, mesh.materials);
    append(answer, mesh.textures);
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
