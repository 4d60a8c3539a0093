// SPDX-License-Identifier: Apache-2.0
#include "core/precomputed_content.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <type_traits>
#include <vector>

#include "core/cube_map.h"
#include "core/errors.h"

namespace refield {

namespace {

constexpr const char* measure_name = "light_measure";
constexpr const char* solid_angle_name = "solid_angle";
constexpr const char* harmonics_name = "harmonics_order";
constexpr const char* outgoing_name = "outgoing_order";
constexpr std::size_t numbers_of_a_camera = 12;

/// Three numbers an element.
template <class Triple>
void write_triples(const Hdf5Writer& writer, const char* name, const std::vector<Triple>& triples) {
  using Number = std::remove_cvref_t<decltype(triples[0][0])>;
  static_assert(sizeof(Triple) == 3 * sizeof(Number));
  writer.dataset(name, reinterpret_cast<const Number*>(triples.data()), {triples.size(), 3});
}

template <class Triple>
std::vector<Triple> read_triples(const Hdf5Values& values, const char* name) {
  using Number = std::remove_cvref_t<decltype(std::declval<Triple>()[0])>;
  const std::vector<Number> numbers = values.dataset<Number>(name, 3);
  if constexpr (std::is_same_v<Number, float>)
    if (!std::ranges::all_of(numbers, [](float number) { return std::isfinite(number); }))
      values.fail(std::string(name) + " contains a value that is not a number");
  std::vector<Triple> triples(numbers.size() / 3);
  for (std::size_t i = 0; i < numbers.size(); ++i) triples[i / 3][i % 3] = numbers[i];
  return triples;
}

void write_camera(const Hdf5Writer& writer, const PinholeCamera& camera) {
  std::vector<float> numbers;
  for (const auto* triple : {&camera.position, &camera.target, &camera.up})
    numbers.insert(numbers.end(), {triple->x(), triple->y(), triple->z()});
  numbers.insert(numbers.end(), {camera.vertical_field_of_view_degrees, static_cast<float>(camera.width),
                                 static_cast<float>(camera.height)});
  writer.dataset("mesh/camera", numbers.data(), {1, numbers_of_a_camera});
}

PinholeCamera read_camera(const Hdf5Values& values) {
  constexpr float max_side_px = 1 << 16;
  const auto n = values.dataset<float>("mesh/camera", numbers_of_a_camera);
  if (n.size() != numbers_of_a_camera || !(n[10] >= 1 && n[10] <= max_side_px) ||
      !(n[11] >= 1 && n[11] <= max_side_px))
    values.fail("mesh/camera is not a valid camera");
  const PinholeCamera camera{{n[0], n[1], n[2]},      {n[3], n[4], n[5]},     {n[6], n[7], n[8]}, n[9],
                             static_cast<int>(n[10]), static_cast<int>(n[11])};
  try {
    camera.check();
  } catch (const InputError& error) {
    values.fail(error.what());
  }
  return camera;
}

void read_mesh(const Hdf5Values& values, ReflectanceField& field) {
  Mesh& mesh = field.mesh;
  mesh.positions = read_triples<Eigen::Vector3f>(values, "mesh/positions");
  mesh.normals = read_triples<Eigen::Vector3f>(values, "mesh/normals");
  mesh.colours = read_triples<Eigen::Array3f>(values, "mesh/colours");
  mesh.triangles = read_triples<std::array<std::uint32_t, 3>>(values, "mesh/triangles");
  const std::size_t vertices = mesh.positions.size();
  if (vertices == 0 || mesh.normals.size() != vertices || mesh.colours.size() != vertices)
    values.fail("mesh/positions, normals and colours do not fit each other");
  for (const auto& triangle : mesh.triangles)
    if (std::ranges::any_of(triangle, [&](std::uint32_t vertex) { return vertex >= vertices; }))
      values.fail("mesh/triangles refers to a vertex that does not exist");
  if (values.has_number(outgoing_name)) field.outgoing_order = values.number(outgoing_name);
  if (field.outgoing_order < 0 || field.outgoing_order > largest_harmonics_order)
    values.fail("has an impossible order of outgoing harmonics");
  if (field.width != output_image_width || field.height != output_image_height(field.mesh_outputs()))
    values.fail("has an image that does not fit its mesh");
}

}  // namespace

void write_precomputed(const Hdf5Writer& writer, const ReflectanceField& field) {
  if (field.basis.measure == Measure::solid_angle) writer.text(measure_name, solid_angle_name);
  if (field.basis.harmonics.order > 0) writer.number(harmonics_name, field.basis.harmonics.order);
  if (field.mesh.empty()) return;
  if (field.outgoing_order > 0) writer.number(outgoing_name, field.outgoing_order);
  writer.group("mesh");
  write_triples(writer, "mesh/positions", field.mesh.positions);
  write_triples(writer, "mesh/normals", field.mesh.normals);
  write_triples(writer, "mesh/colours", field.mesh.colours);
  write_triples(writer, "mesh/triangles", field.mesh.triangles);
  if (field.camera) write_camera(writer, *field.camera);
}

std::uint64_t precomputed_bytes(const ReflectanceField& field) {
  return field.mesh.positions.size() * 9 * sizeof(float) +
         field.mesh.triangles.size() * 3 * sizeof(std::uint32_t);
}

void read_precomputed(const Hdf5Values& values, ReflectanceField& field) {
  LightBasis& basis = field.basis;
  if (values.outline.texts.contains(measure_name)) {
    if (values.text(measure_name) != solid_angle_name)
      values.fail("measures light by '" + values.text(measure_name) +
                  "', which this version does not support");
    basis.measure = Measure::solid_angle;
    if (basis.domain != cube_domain(basis.domain.width))
      values.fail("measures light by solid angle, but not over a cube map");
  }
  if (values.has_number(harmonics_name)) basis.harmonics.order = values.number(harmonics_name);
  if (basis.harmonics.order < 0 || basis.harmonics.order > largest_harmonics_order ||
      basis.harmonics.order > basis.domain.width ||
      (basis.harmonics.order > 0 && basis.measure != Measure::solid_angle))
    values.fail("has impossible harmonics");
  if (!values.has("mesh/positions")) return;
  read_mesh(values, field);
  if (values.has("mesh/camera")) field.camera = read_camera(values);
}

}  // namespace refield
