// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/mesh_shapes.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "simulate/prt/mesh_file.h"

namespace refield::prt {

namespace {

/// A square of side 1 about `centre`; right × up is the way it faces.
void add_square(const Eigen::Vector3f& centre, const Eigen::Vector3f& right, const Eigen::Vector3f& up,
                int resolution, Mesh& mesh) {
  const auto first = static_cast<std::uint32_t>(mesh.positions.size());
  const auto across = static_cast<std::uint32_t>(resolution) + 1;
  for (std::uint32_t j = 0; j < across; ++j)
    for (std::uint32_t i = 0; i < across; ++i)
      mesh.positions.push_back(centre +
                               (static_cast<float>(i) / static_cast<float>(resolution) - 0.5f) * right +
                               (static_cast<float>(j) / static_cast<float>(resolution) - 0.5f) * up);
  for (std::uint32_t j = 0; j + 1 < across; ++j) {
    for (std::uint32_t i = 0; i + 1 < across; ++i) {
      const std::uint32_t a = first + j * across + i, b = a + 1, c = a + across, d = c + 1;
      // Diagonals alternate, so that none runs through the whole square.
      if ((i + j) % 2 == 0)
        mesh.triangles.insert(mesh.triangles.end(), {{{a, b, d}}, {{a, d, c}}});
      else
        mesh.triangles.insert(mesh.triangles.end(), {{{a, b, c}}, {{b, d, c}}});
    }
  }
}

void finish(Mesh& mesh) {
  mesh.colours.assign(mesh.positions.size(), Eigen::Array3f::Ones());
  compute_normals(mesh);
}

/// The unit icosahedron's faces, counter-clockwise in the sense of core/mesh.h.
std::vector<std::array<Eigen::Vector3d, 3>> icosahedron() {
  constexpr double g = std::numbers::phi;
  std::vector<Eigen::Vector3d> corners;
  for (const double one : {-1.0, 1.0})
    for (const double golden : {-g, g})
      for (const Eigen::Vector3d& corner : {Eigen::Vector3d(0, one, golden), Eigen::Vector3d(one, golden, 0),
                                            Eigen::Vector3d(golden, 0, one)})
        corners.push_back(corner);
  std::vector<std::array<Eigen::Vector3d, 3>> faces;
  constexpr double edge_squared = 4.0, slack = 1e-9;
  const auto joined = [&](const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
    return std::abs((a - b).squaredNorm() - edge_squared) < slack;
  };
  for (std::size_t a = 0; a < corners.size(); ++a)
    for (std::size_t b = a + 1; b < corners.size(); ++b)
      for (std::size_t c = b + 1; c < corners.size(); ++c) {
        if (!joined(corners[a], corners[b]) || !joined(corners[b], corners[c]) ||
            !joined(corners[a], corners[c]))
          continue;
        const bool outwards = (corners[b] - corners[a]).cross(corners[c] - corners[a]).dot(corners[a]) > 0.0;
        faces.push_back({corners[a], outwards ? corners[b] : corners[c], outwards ? corners[c] : corners[b]});
      }
  return faces;
}

/// Unit directions.
Mesh directions_mesh(int resolution) {
  Mesh mesh;
  std::map<std::array<long, 3>, std::uint32_t>
      number;  // of a point on the faces, told by rounded coordinates
  const auto vertex = [&](const Eigen::Vector3d& point) {
    const std::array key{std::lround(point.x() * 1e9), std::lround(point.y() * 1e9),
                         std::lround(point.z() * 1e9)};
    const auto [found, is_new] = number.emplace(key, static_cast<std::uint32_t>(mesh.positions.size()));
    if (is_new) mesh.positions.push_back(point.normalized().cast<float>());
    return found->second;
  };
  for (const auto& [a, b, c] : icosahedron()) {
    const Eigen::Vector3d right = (b - a) / resolution, up = (c - a) / resolution;
    const auto at = [&, origin = a](int i, int j) { return vertex(origin + i * right + j * up); };
    for (int j = 0; j < resolution; ++j)
      for (int i = 0; i + j < resolution; ++i) {
        mesh.triangles.push_back({at(i, j), at(i + 1, j), at(i, j + 1)});
        if (i + j + 1 < resolution) mesh.triangles.push_back({at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)});
      }
  }
  return mesh;
}

/// Distance of the hare's skin from its middle, in a unit direction; it looks against +Z.
float hare_radius(const Eigen::Vector3f& direction) {
  const auto lobe = [&](float x, float y, float z, float height, float narrowness) {
    return height * std::exp(narrowness * (direction.dot(Eigen::Vector3f(x, y, z).normalized()) - 1.0f));
  };
  const float ears = lobe(0.45f, 1.0f, 0.25f, 1.1f, 45.0f) + lobe(-0.45f, 1.0f, 0.25f, 1.1f, 45.0f);
  const float face = lobe(0.0f, -0.2f, -1.0f, 0.25f, 14.0f) + lobe(0.5f, -0.45f, -0.8f, 0.12f, 20.0f) +
                     lobe(-0.5f, -0.45f, -0.8f, 0.12f, 20.0f);
  const float fur = 0.02f * std::sin(9.0f * direction.x()) * std::sin(8.0f * direction.y() + 1.0f) *
                    std::sin(10.0f * direction.z() + 2.0f);
  return 0.4f * (1.0f + ears + face + fur);
}

}  // namespace

Mesh plane_mesh(int resolution) {
  Mesh mesh;
  add_square(Eigen::Vector3f::Zero(), Eigen::Vector3f::UnitZ(), Eigen::Vector3f::UnitX(), resolution, mesh);
  finish(mesh);
  return mesh;
}

Mesh box_mesh(int resolution) {
  Mesh mesh;
  for (int axis = 0; axis < 3; ++axis)
    for (const float side : {-1.0f, 1.0f}) {
      const Eigen::Vector3f out = side * Eigen::Vector3f::Unit(axis);
      const Eigen::Vector3f right = Eigen::Vector3f::Unit((axis + 1) % 3);
      add_square(0.5f * out, right, out.cross(right), resolution, mesh);
    }
  finish(mesh);
  return mesh;
}

Mesh sphere_mesh(int resolution) {
  Mesh mesh = directions_mesh(resolution);
  for (auto& position : mesh.positions) position *= 0.5f;
  finish(mesh);
  return mesh;
}

Mesh hare_mesh(int resolution) {
  Mesh mesh = directions_mesh(resolution);
  for (auto& position : mesh.positions) position *= hare_radius(position);
  finish(mesh);
  return mesh;
}

}  // namespace refield::prt
