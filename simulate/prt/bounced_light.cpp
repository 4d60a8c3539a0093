// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/bounced_light.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "core/cube_map.h"
#include "core/run_context.h"
#include "simulate/prt/hammersley.h"

namespace refield::prt {

namespace {

constexpr int gather_rays = 128;
constexpr int cells_of_side = 8;
constexpr int cells_of_face = cells_of_side * cells_of_side;
constexpr std::size_t cells = static_cast<std::size_t>(cube_faces) * cells_of_face;
constexpr int directions_of_side = 2;  // of a cell

using VertexLight = std::vector<Eigen::Array3f>;  // at vertices or points

/// What points see: rows of (vertex, share of its radiance in E ∕ π).
class Surroundings {
 public:
  Surroundings(const MeshRays& rays, std::span<const Gatherer> points, const RunContext& run)
      : rows_(points.size()) {
    const std::vector<Eigen::Vector3d> around = hammersley_sphere(gather_rays);
    Progress progress(run, "gathering indirect light", points.size());
    tbb::parallel_for(std::size_t{0}, points.size(), [&](std::size_t p) {
      if (run.is_stopped()) return;  // thrown away
      if (!points[p].normal.isZero())
        for (const Eigen::Vector3d& direction : around)
          look(rays, points[p], direction.cast<float>(), rows_[p]);
      progress.advance();
    });
    run.throw_if_stopped();
  }

  VertexLight gather(const VertexLight& radiance) const {
    VertexLight gathered(rows_.size(), Eigen::Array3f::Zero());
    for (std::size_t p = 0; p < rows_.size(); ++p)
      for (const Seen& seen : rows_[p]) gathered[p] += seen.share * radiance[seen.vertex];
    return gathered;
  }

 private:
  struct Seen {
    std::uint32_t vertex;
    float share;
  };

  /// A point of the unit sphere that touches a surface lies in a direction of cosine distribution.
  static void look(const MeshRays& rays, const Gatherer& point, const Eigen::Vector3f& on_sphere,
                   std::vector<Seen>& row) {
    const Eigen::Vector3f direction = point.normal + on_sphere;
    const float length = direction.norm();
    if (length < 1e-3f) return;
    const auto hit = rays.intersect(point.position, direction / length);
    if (!hit || !hit->front) return;
    const auto& corners = rays.mesh().triangles[hit->triangle];
    for (std::size_t i = 0; i < corners.size(); ++i) row.push_back({corners[i], hit->share[i] / gather_rays});
  }

  std::vector<std::vector<Seen>> rows_;
};

std::vector<Gatherer> gatherers_of(const Scene& scene, const MeshRays& rays) {
  const Mesh& mesh = scene.mesh;
  std::vector<Gatherer> points(mesh.positions.size());
  for (std::size_t v = 0; v < points.size(); ++v)
    points[v] = {rays.off_surface(mesh.positions[v], mesh.normals[v]), mesh.normals[v]};
  return points;
}

/// V cos ∕ π at vertices.
void add_direct(const MeshRays& rays, std::span<const Gatherer> vertices, const Eigen::Vector3f& direction,
                VertexLight& light) {
  std::array<Eigen::Vector3f, MeshRays::packet> points;
  std::array<std::size_t, MeshRays::packet> vertex;
  std::size_t count = 0;
  const auto trace = [&] {
    const std::uint32_t free = rays.unoccluded({points.data(), count}, direction);
    for (std::size_t i = 0; i < count; ++i)
      if (free >> i & 1)
        light[vertex[i]] += vertices[vertex[i]].normal.dot(direction) * std::numbers::inv_pi_v<float>;
    count = 0;
  };
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    if (vertices[v].normal.dot(direction) <= 0.0f) continue;
    points[count] = vertices[v].position;
    vertex[count++] = v;
    if (count == MeshRays::packet) trace();
  }
  if (count > 0) trace();
}

}  // namespace

BouncedLight::BouncedLight(const Scene& scene, const MeshRays& rays, std::span<const Gatherer> points,
                           int bounces, const RunContext& run)
    : blocks_((points.size() + block - 1) / block), table_(blocks_ * cells * 3 * block) {
  const std::vector<Gatherer> vertices = gatherers_of(scene, rays);
  const VertexLight reflectance = diffuse_reflectance(scene);
  const Surroundings of_vertices(rays, vertices, run), of_points(rays, points, run);
  Progress progress(run, "computing indirect light", cells);
  tbb::parallel_for(std::size_t{0}, cells, [&](std::size_t cell) {
    if (run.is_stopped()) return;  // thrown away
    constexpr int side = cells_of_side * directions_of_side;
    const auto x = static_cast<int>(cell) % cells_of_side, y = static_cast<int>(cell) / cells_of_side;
    VertexLight direct(vertices.size(), Eigen::Array3f::Zero());
    for (int k = 0; k < directions_of_side * directions_of_side; ++k)
      add_direct(rays, vertices,
                 cube_direction(directions_of_side * x + k % directions_of_side + 0.5,
                                directions_of_side * y + k / directions_of_side + 0.5, side)
                     .cast<float>(),
                 direct);
    for (auto& light : direct) light /= directions_of_side * directions_of_side;
    // All in linear terms: radiance = reflectance (direct + gathered radiance).
    VertexLight radiance(vertices.size(), Eigen::Array3f::Zero());
    for (int bounce = 0; bounce < bounces; ++bounce) {
      radiance = of_vertices.gather(radiance);
      for (std::size_t v = 0; v < vertices.size(); ++v)
        radiance[v] = reflectance[v] * (radiance[v] + direct[v]);
    }
    const VertexLight gathered = of_points.gather(radiance);
    for (std::size_t p = 0; p < points.size(); ++p)
      for (std::size_t c = 0; c < 3; ++c)
        table_[((p / block * cells + cell) * 3 + c) * block + p % block] =
            Eigen::half(gathered[p][static_cast<Eigen::Index>(c)]);
    progress.advance();
  });
  run.throw_if_stopped();
}

void BouncedLight::add(std::size_t of_block, const Eigen::Vector3f& direction,
                       std::span<float> values) const {
  const Eigen::Vector2d at = cube_position(direction.cast<double>(), cells_of_side);
  const int face = std::min(static_cast<int>(at.y()) / cells_of_side, cube_faces - 1);
  const auto between = [](double position) { return std::clamp(position - 0.5, 0.0, cells_of_side - 1.0); };
  const double x = between(at.x()), y = between(at.y() - face * cells_of_side);
  const int x0 = std::min(static_cast<int>(x), cells_of_side - 2),
            y0 = std::min(static_cast<int>(y), cells_of_side - 2);
  for (int k = 0; k < 4; ++k) {
    const int dx = k % 2, dy = k / 2;
    const auto share = static_cast<float>((dx ? x - x0 : 1.0 - (x - x0)) * (dy ? y - y0 : 1.0 - (y - y0)));
    const auto cell = static_cast<std::size_t>(face * cells_of_face + (y0 + dy) * cells_of_side + x0 + dx);
    const Eigen::half* from = &table_[(of_block * cells + cell) * 3 * block];
    for (std::size_t i = 0; i < values.size(); ++i) values[i] += share * static_cast<float>(from[i]);
  }
}

bool bounces_grey(const Scene& scene) {
  return std::ranges::all_of(diffuse_reflectance(scene),
                             [](const Eigen::Array3f& value) { return (value == value[0]).all(); });
}

}  // namespace refield::prt
