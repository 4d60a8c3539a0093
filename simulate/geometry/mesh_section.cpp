// SPDX-License-Identifier: Apache-2.0
#include "simulate/geometry/mesh_section.h"

#include <array>
#include <optional>
#include <string>

#include "core/base/errors.h"
#include "simulate/geometry/mesh_file.h"
#include "simulate/geometry/mesh_shapes.h"
#include "simulate/geometry/place_mesh.h"

namespace refield::prt {

namespace fs = std::filesystem;

namespace {

std::array<double, 3> read_triple(ConfigSection& section, const char* key, double low, double high,
                                  std::array<double, 3> value = {}) {
  section.triple(key, value, low, high);
  return value;
}

}  // namespace

Eigen::Vector3f read_vector(ConfigSection& section, const char* key, const Eigen::Vector3f& standard,
                            double low, double high) {
  const auto value = read_triple(section, key, low, high, {standard.x(), standard.y(), standard.z()});
  return Eigen::Vector3d(value[0], value[1], value[2]).cast<float>();
}

float read_number(ConfigSection& section, const char* key, float standard, double low, double high) {
  double value = standard;
  section.number(key, value, low, high);
  return static_cast<float>(value);
}

namespace {

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
  Make make = plane_mesh;
  section.choice<Make>(
      "shape", make,
      {{"plane", plane_mesh}, {"box", box_mesh}, {"sphere", sphere_mesh}, {"rabbit", rabbit_mesh}});
  int resolution = make == plane_mesh || make == box_mesh ? 1 : 32;
  // A few million vertices at most.
  section.integer("resolution", resolution, 1, make == plane_mesh ? 2048 : 512);
  return make(resolution);
}

Mesh read_file(ConfigSection& section, const fs::path& folder, const RunContext& run) {
  std::string name;
  section.text("file", name);
  std::optional<ColourCoding> coding;
  section.choice<std::optional<ColourCoding>>(
      "colours", coding, {{"srgb", ColourCoding::srgb}, {"linear", ColourCoding::linear}});
  return read_mesh_file(folder / name, coding, run);
}

}  // namespace

Mesh read_mesh(ConfigSection& section, const fs::path& folder, const RunContext& run) {
  if (section.has("file") == section.has("shape")) section.fail("shape", "give either `shape` or `file`");
  Mesh mesh = section.has("file") ? read_file(section, folder, run) : read_shape(section);
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

}  // namespace refield::prt
