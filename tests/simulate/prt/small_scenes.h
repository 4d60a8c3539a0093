// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/field/reflectance_field.h"
#include "core/light/cube_map.h"
#include "simulate/geometry/mesh_shapes.h"
#include "simulate/geometry/place_mesh.h"
#include "simulate/prt/prt_scene.h"

namespace refield::prt::test {

inline void add(Scene& scene, Mesh mesh, const Placement& placement, const Material& material) {
  place(mesh, placement);
  const auto first = static_cast<std::uint32_t>(scene.mesh.positions.size());
  for (auto triangle : mesh.triangles) {
    for (std::uint32_t& corner : triangle) corner += first;
    scene.mesh.triangles.push_back(triangle);
  }
  const auto append = [](auto& to, const auto& from) { to.insert(to.end(), from.begin(), from.end()); };
  append(scene.mesh.positions, mesh.positions);
  append(scene.mesh.normals, mesh.normals);
  append(scene.mesh.colours, mesh.colours);
  scene.material_of_vertex.resize(scene.mesh.positions.size(),
                                  static_cast<std::uint16_t>(scene.materials.size()));
  scene.materials.push_back(material);
}

inline Placement stretched(float side) {
  Placement placement;
  placement.stretch = {side, 1.0f, side};
  return placement;
}

inline Placement on_ground(float size) {
  Placement placement;
  placement.size = size;
  placement.on_ground = true;
  return placement;
}

inline Scene plane_scene(int resolution = 8) {
  Scene scene;
  add(scene, plane_mesh(resolution), stretched(4.0f), {});
  sort_vertices(scene);
  return scene;
}

/// A rabbit's head on a plane, some hundred vertices.
inline Scene rabbit_scene() {
  Scene scene;
  add(scene, rabbit_mesh(5), on_ground(1.0f), {.diffuse = {0.9f, 0.6f, 0.3f}});
  add(scene, plane_mesh(16), stretched(3.0f), {});
  sort_vertices(scene);
  return scene;
}

/// A glossy ball, which few pixels see, on a diffuse plane, which the others do.
inline Scene glossy_scene() {
  Scene scene;
  add(scene, sphere_mesh(12), on_ground(0.5f),
      {.diffuse = {0.1f, 0.1f, 0.1f}, .specular = {0.06f, 0.06f, 0.06f}, .exponent = 300.0f});
  add(scene, plane_mesh(2), stretched(20.0f), {});
  scene.camera =
      PinholeCamera{.position = {0.0f, 1.5f, -3.0f}, .target = {0.0f, 0.2f, 0.0f}, .width = 48, .height = 32};
  return scene;
}

/// Ground, a coloured wall and a ball, apart by more than a cell: interreflection is interpolated between
/// vertices, which is wrong where it changes within a triangle.
inline Scene ball_scene(const Material& ball) {
  const Eigen::Vector3f twice(2.0f, 2.0f, 2.0f);
  Scene scene;
  add(scene, plane_mesh(10), {.stretch = twice}, {{0.8f, 0.7f, 0.5f}, {0.0f, 0.0f, 0.0f}, 0.0f});
  add(scene, plane_mesh(10),
      {.stretch = twice, .turn = {.roll = -90.0}, .position = Eigen::Vector3f(-1.1f, 1.2f, 0.0f)},
      {{0.9f, 0.2f, 0.1f}, {0.0f, 0.0f, 0.0f}, 0.0f});
  add(scene, sphere_mesh(9), {.position = Eigen::Vector3f(0.0f, 0.8f, 0.0f)}, ball);
  return scene;
}

/// The field as a whole.
inline ReflectanceField field_of(const FieldRows& rows) {
  return {rows.outline, rows.rows({0, rows.outline.height})};
}

/// A cube map, black but for squares of side² texels around the given texels, whose radiance gives white
/// that faces one of them an output of 1.
inline LightMap area_lights(int resolution, int side, const std::vector<Eigen::Vector2i>& texels) {
  LightMap light{Image(resolution, cube_faces * resolution, 3), Parameterisation::cube};
  for (const Eigen::Vector2i& texel : texels)
    for (int y = texel.y() - side / 2; y < texel.y() - side / 2 + side; ++y)
      for (int x = texel.x() - side / 2; x < texel.x() - side / 2 + side; ++x)
        for (int c = 0; c < 3; ++c)
          light.radiance.at(x, y, c) =
              static_cast<float>(3.14159265 / (side * side * cube_solid_angle(x, y, resolution)));
  return light;
}

}  // namespace refield::prt::test
