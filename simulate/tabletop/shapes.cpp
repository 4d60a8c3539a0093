// SPDX-License-Identifier: Apache-2.0
#include "simulate/tabletop/shapes.h"

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

namespace refield {

namespace {

constexpr int lathe_segments = 160;
constexpr int curve_steps = 8;  // between two points of a smooth profile

void add_face(TriangleMesh& mesh, const Eigen::Vector3f& centre, const Eigen::Vector3f& u,
              const Eigen::Vector3f& v) {
  const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
  for (const auto& [a, b] : {std::pair{-1, -1}, {1, -1}, {1, 1}, {-1, 1}})
    mesh.vertices.push_back(centre + static_cast<float>(a) * u + static_cast<float>(b) * v);
  mesh.normals.insert(mesh.normals.end(), 4, u.cross(v).normalized());
  mesh.triangles.push_back({first, first + 1, first + 2});
  mesh.triangles.push_back({first, first + 2, first + 3});
}

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

TriangleMesh quad_mesh(const Eigen::Vector3d& size) {
  TriangleMesh mesh;
  add_face(mesh, {0, 0, 0}, {0, 0, static_cast<float>(size.z() / 2)},
           {static_cast<float>(size.x() / 2), 0, 0});
  return mesh;
}

TriangleMesh box_mesh(const Eigen::Vector3d& size) {
  TriangleMesh mesh;
  const Eigen::Vector3f half = (size / 2).cast<float>();
  for (int axis = 0; axis < 3; ++axis)
    for (float side : {-1.0f, 1.0f}) {
      Eigen::Vector3f centre = Eigen::Vector3f::Zero(), u = centre, v = centre;
      const int a = (axis + 1) % 3, b = (axis + 2) % 3;
      centre[axis] = side * half[axis];
      u[a] = half[a];
      v[b] = side * half[b];  // turns the face over with its side
      add_face(mesh, centre, u, v);
    }
  return mesh;
}

TriangleMesh lathe_mesh(const std::vector<Eigen::Vector2d>& profile, bool smooth) {
  TriangleMesh mesh;
  for (const Stretch& stretch : stretches_of(profile, smooth)) {
    const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
    const auto rings = static_cast<std::uint32_t>(stretch.points.size());
    for (std::uint32_t k = 0; k < rings; ++k)
      for (int s = 0; s < lathe_segments; ++s) {
        const double turn = 2.0 * std::numbers::pi * s / lathe_segments;
        const auto around = [&](const Eigen::Vector2d& p) {
          return Eigen::Vector3d(p.x() * std::cos(turn), p.y(), p.x() * std::sin(turn)).cast<float>().eval();
        };
        mesh.vertices.push_back(around(stretch.points[k]));
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
  return mesh;
}

}  // namespace refield
