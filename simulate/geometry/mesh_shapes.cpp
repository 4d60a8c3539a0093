// SPDX-License-Identifier: Apache-2.0
#include "simulate/geometry/mesh_shapes.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "simulate/geometry/mesh_file.h"

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

/// The unit icosahedron's faces, counter-clockwise in the sense of core/field/mesh.h.
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
      number;  // of a point on the faces, represented by rounded coordinates
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

/// Distance of the rabbit's skin from its middle, in a unit direction; it looks against +Z.
float rabbit_radius(const Eigen::Vector3f& direction) {
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

Mesh rabbit_mesh(int resolution) {
  Mesh mesh = directions_mesh(resolution);
  for (auto& position : mesh.positions) position *= rabbit_radius(position);
  finish(mesh);
  return mesh;
}

namespace {

constexpr int lathe_segments = 160;
constexpr int curve_steps = 8;  // between two points of a smooth profile

// A stretch of the profile without a corner: points and outward normals in (radius, height).
struct Stretch {
  std::vector<Eigen::Vector2d> points;
  std::vector<Eigen::Vector2d> normals;
};

Eigen::Vector2d right_of(const Eigen::Vector2d& direction) {
  return Eigen::Vector2d(direction.y(), -direction.x()).normalized();
}

// Uniform Catmull–Rom curve through `points`, with the ends mirrored.
Stretch smooth_stretch(const std::vector<Eigen::Vector2d>& points) {
  Stretch stretch;
  const int last = static_cast<int>(points.size()) - 1;
  const auto at = [&](int i) -> Eigen::Vector2d {
    if (i < 0) return 2.0 * points[0] - points[1];
    if (i > last) return 2.0 * points[last] - points[last - 1];
    return points[i];
  };
  for (int i = 0; i < last; ++i) {
    const Eigen::Vector2d a = at(i - 1), b = at(i), c = at(i + 1), d = at(i + 2);
    for (int step = 0; step < curve_steps + (i + 1 == last); ++step) {
      const double t = static_cast<double>(step) / curve_steps;
      Eigen::Vector2d p = 0.5 * (2.0 * b + (c - a) * t + (2.0 * a - 5.0 * b + 4.0 * c - d) * t * t +
                                 (3.0 * b - a - 3.0 * c + d) * t * t * t);
      const Eigen::Vector2d tangent = 0.5 * ((c - a) + 2.0 * (2.0 * a - 5.0 * b + 4.0 * c - d) * t +
                                             3.0 * (3.0 * b - a - 3.0 * c + d) * t * t);
      p.x() = std::max(p.x(), 0.0);
      stretch.points.push_back(p);
      stretch.normals.push_back(right_of(tangent));
    }
  }
  return stretch;
}

std::vector<Stretch> stretches_of(const std::vector<Eigen::Vector2d>& profile, bool smooth) {
  std::vector<Stretch> stretches;
  std::vector<Eigen::Vector2d> run;
  const auto flush = [&] {
    if (run.size() >= 2) stretches.push_back(smooth_stretch(run));
    run.clear();
  };
  for (const Eigen::Vector2d& p : profile) {
    if (!run.empty() && (p - run.back()).norm() < 1e-9) flush();  // given twice: a corner
    run.push_back(p);
    if (!smooth && run.size() == 2) {
      stretches.push_back({{run[0], run[1]}, {2, right_of(run[1] - run[0])}});
      run.erase(run.begin());
    }
  }
  if (smooth) flush();
  return stretches;
}

}  // namespace

Mesh lathe_mesh(const std::vector<Eigen::Vector2d>& profile, bool smooth) {
  Mesh mesh;
  for (const Stretch& stretch : stretches_of(profile, smooth)) {
    const auto first = static_cast<std::uint32_t>(mesh.positions.size());
    const auto rings = static_cast<std::uint32_t>(stretch.points.size());
    for (std::uint32_t k = 0; k < rings; ++k)
      for (int s = 0; s < lathe_segments; ++s) {
        const double turn = 2.0 * std::numbers::pi * s / lathe_segments;
        const auto around = [&](const Eigen::Vector2d& p) {
          return Eigen::Vector3d(p.x() * std::cos(turn), p.y(), p.x() * std::sin(turn)).cast<float>().eval();
        };
        mesh.positions.push_back(around(stretch.points[k]));
        mesh.normals.push_back(around(stretch.normals[k]).normalized());
      }
    for (std::uint32_t k = 0; k + 1 < rings; ++k)
      for (std::uint32_t s = 0; s < lathe_segments; ++s) {
        const std::uint32_t next = (s + 1) % lathe_segments;
        const std::uint32_t a = first + k * lathe_segments + s, b = first + k * lathe_segments + next;
        const std::uint32_t c = a + lathe_segments, d = b + lathe_segments;
        // A triangle that has two corners on the axis is none.
        if (stretch.points[k].x() > 0.0) mesh.triangles.push_back({a, d, b});
        if (stretch.points[k + 1].x() > 0.0) mesh.triangles.push_back({a, c, d});
      }
  }
  mesh.colours.assign(mesh.positions.size(), Eigen::Array3f::Ones());
  return mesh;
}

}  // namespace refield::prt
