// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/prt_scene.h"

#include <algorithm>
#include <cctype>

#include "core/base/config_file.h"
#include "core/base/errors.h"
#include "simulate/geometry/mesh_file.h"
#include "simulate/geometry/mesh_section.h"
#include "simulate/geometry/mesh_shapes.h"
#include "simulate/geometry/place_mesh.h"

namespace refield::prt {

namespace fs = std::filesystem;

namespace {

Material read_material(ConfigSection& section) {
  Material material;
  material.diffuse = read_vector(section, "diffuse", material.diffuse.matrix(), 0.0, 1.0).array();
  material.specular = read_vector(section, "specular", material.specular.matrix(), 0.0, 1.0).array();
  if (!material.is_diffuse()) {
    section.require("exponent");
    if ((material.diffuse + material.specular > 1.0f).any())
      section.fail("specular", "with `diffuse` it must not add up to more than 1");
  } else if (section.has("exponent")) {
    section.fail("exponent", "it needs `specular`, too");
  }
  material.exponent = read_number(section, "exponent", 0.0f, 1.0, 1e5);
  return material;
}

void append(const Mesh& mesh, const Material& material, Scene& scene) {
  prt::append(mesh, Eigen::Isometry3f::Identity(), scene.mesh);
  scene.material_of_vertex.resize(scene.mesh.positions.size(),
                                  static_cast<std::uint16_t>(scene.materials.size()));
  scene.materials.push_back(material);
}

Scene read_description(const fs::path& path, const RunContext& run) {
  const ConfigFile file(path, "scene", "docs/reference/mesh-scenes.md");
  file.check_names({"camera", "mesh"});
  std::vector<ConfigSection> meshes = file.sections("mesh");
  constexpr std::size_t max_meshes = 65535;  // materials are numbered in 16 bits
  if (meshes.size() > max_meshes)
    throw InputError(path.string() + ": a scene takes " + std::to_string(max_meshes) + " meshes; join some");
  Scene scene;
  for (ConfigSection& section : meshes) {
    const Material material = read_material(section);
    const Mesh mesh = read_mesh(section, path.parent_path(), run);
    section.finish();
    append(mesh, material, scene);
    if (scene.mesh.triangles.size() > max_triangles)
      throw InputError(path.string() + ": the scene has more than " + std::to_string(max_triangles) +
                       " triangles; simplify its meshes or refine them less");
  }
  if (file.has("camera")) scene.camera = read_camera(file.section("camera"));
  return scene;
}

}  // namespace

Scene read_scene(const fs::path& path, const RunContext& run) {
  std::string extension = path.extension().string();
  for (char& letter : extension) letter = static_cast<char>(std::tolower(static_cast<unsigned char>(letter)));
  if (extension == ".toml") return read_description(path, run);
  Scene scene;
  append(read_mesh_file(path, std::nullopt, run), Material{}, scene);
  return scene;
}

std::vector<Eigen::Array3f> diffuse_reflectance(const Scene& scene) {
  std::vector<Eigen::Array3f> reflectance = scene.mesh.colours;
  for (std::size_t v = 0; v < reflectance.size(); ++v)
    reflectance[v] *= scene.materials[scene.material_of_vertex[v]].diffuse;
  return reflectance;
}

}  // namespace refield::prt
