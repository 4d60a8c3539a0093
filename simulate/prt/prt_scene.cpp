// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/prt_scene.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <functional>
#include <map>

#include "core/config_file.h"
#include "core/errors.h"
#include "simulate/prt/mesh_file.h"
#include "simulate/prt/mesh_shapes.h"
#include "simulate/prt/place_mesh.h"
#include "simulate/prt/refine_mesh.h"

namespace refield::prt {

namespace fs = std::filesystem;

namespace {

constexpr double farthest = 1e6;

std::array<double, 3> read_triple(ConfigSection& section, const char* key, double low, double high,
                                  std::array<double, 3> value = {}) {
  section.triple(key, value, low, high);
  return value;
}

Eigen::Vector3f read_vector(ConfigSection& section, const char* key, const Eigen::Vector3f& standard,
                            double low = -farthest, double high = farthest) {
  const auto value = read_triple(section, key, low, high, {standard.x(), standard.y(), standard.z()});
  return Eigen::Vector3d(value[0], value[1], value[2]).cast<float>();
}

float read_number(ConfigSection& section, const char* key, float standard, double low, double high) {
  double value = standard;
  section.number(key, value, low, high);
  return static_cast<float>(value);
}

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

Placement read_placement(ConfigSection& section) {
  Placement placement;
  placement.stretch = read_vector(section, "stretch", placement.stretch, 1e-6, farthest);
  const auto turn = read_triple(section, "rotation", -360.0, 360.0);
  placement.turn = {turn[0], turn[1], turn[2]};
  if (section.has("size")) placement.size = read_number(section, "size", 1.0f, 1e-6, farthest);
  if (section.has("position")) placement.position = read_vector(section, "position", {0, 0, 0});
  section.flag("on_ground", placement.on_ground);
  return placement;
}

Mesh read_shape(ConfigSection& section) {
  using Make = Mesh (*)(int);
  constexpr int finest = 2048;  // of a plane: four million vertices
  Make make = plane_mesh;
  section.choice<Make>(
      "shape", make,
      {{"plane", plane_mesh}, {"box", box_mesh}, {"sphere", sphere_mesh}, {"hare", hare_mesh}});
  int resolution = make == plane_mesh || make == box_mesh ? 1 : 32;
  section.integer("resolution", resolution, 1, finest);
  return make(resolution);
}

Mesh read_file(ConfigSection& section, const fs::path& folder) {
  std::string name;
  section.text("file", name);
  std::optional<ColourCoding> coding;
  section.choice<std::optional<ColourCoding>>(
      "colours", coding, {{"srgb", ColourCoding::srgb}, {"linear", ColourCoding::linear}});
  return read_mesh_file(folder / name, coding);
}

Mesh read_mesh(ConfigSection& section, const fs::path& folder) {
  if (section.has("file") == section.has("shape")) section.fail("shape", "give either `shape` or `file`");
  Mesh mesh = section.has("file") ? read_file(section, folder) : read_shape(section);
  place(mesh, read_placement(section));
  if (section.has("refine")) {
    const float longest_edge = read_number(section, "refine", 1.0f, 1e-6, farthest);
    try {
      refine(mesh, longest_edge);
    } catch (const InputError& error) {
      section.fail("refine", error.what());
    }
  }
  return mesh;
}

void append(const Mesh& mesh, const Material& material, Scene& scene) {
  const auto first = static_cast<std::uint32_t>(scene.mesh.positions.size());
  const auto join = [](auto& all, const auto& more) { all.insert(all.end(), more.begin(), more.end()); };
  join(scene.mesh.positions, mesh.positions);
  join(scene.mesh.normals, mesh.normals);
  join(scene.mesh.colours, mesh.colours);
  for (const auto& [a, b, c] : mesh.triangles)
    scene.mesh.triangles.push_back({first + a, first + b, first + c});
  scene.material_of_vertex.resize(scene.mesh.positions.size(),
                                  static_cast<std::uint16_t>(scene.materials.size()));
  scene.materials.push_back(material);
}

PinholeCamera read_camera(ConfigSection section) {
  PinholeCamera camera;
  for (const char* key : {"position", "target"}) section.require(key);
  camera.position = read_vector(section, "position", camera.position);
  camera.target = read_vector(section, "target", camera.target);
  camera.up = read_vector(section, "up", camera.up, -1.0, 1.0);
  camera.vertical_field_of_view_degrees =
      read_number(section, "vertical_fov_degrees", camera.vertical_field_of_view_degrees, 1.0, 150.0);
  section.integer("width", camera.width, 1, 16384);
  section.integer("height", camera.height, 1, 16384);
  section.finish();
  try {
    camera.check();
  } catch (const InputError& error) {
    section.fail("target", error.what());
  }
  return camera;
}

Scene read_description(const fs::path& path) {
  const ConfigFile file(path, "scene", "docs/prt-scenes.md");
  file.check_names({"camera", "mesh"});
  std::vector<ConfigSection> meshes = file.sections("mesh");
  constexpr std::size_t most_meshes = 65535;  // materials are numbered in 16 bits
  if (meshes.size() > most_meshes)
    throw InputError(path.string() + ": a scene takes " + std::to_string(most_meshes) + " meshes; join some");
  Scene scene;
  for (ConfigSection& section : meshes) {
    const Material material = read_material(section);
    const Mesh mesh = read_mesh(section, path.parent_path());
    section.finish();
    append(mesh, material, scene);
    if (scene.mesh.triangles.size() > most_triangles)
      throw InputError(path.string() + ": the scene has more than " + std::to_string(most_triangles) +
                       " triangles; simplify its meshes or refine them less");
  }
  if (file.has("camera")) scene.camera = read_camera(file.section("camera"));
  return scene;
}

}  // namespace

Scene read_scene(const fs::path& path) {
  std::string extension = path.extension().string();
  for (char& letter : extension) letter = static_cast<char>(std::tolower(static_cast<unsigned char>(letter)));
  if (extension == ".toml") return read_description(path);
  Scene scene;
  append(read_mesh_file(path), Material{}, scene);
  return scene;
}

}  // namespace refield::prt
