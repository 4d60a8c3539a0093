// SPDX-License-Identifier: Apache-2.0
#include "simulate/geometry/path_trace.h"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "core/base/rng.h"
#include "core/base/run_context.h"

namespace refield::prt {

namespace {

constexpr float pi = std::numbers::pi_v<float>;

/// The material's reflection and how to draw directions from it.
class Reflection {
 public:
  Reflection(const SurfacePoint& point, const Eigen::Vector3f& to_viewer)
      : point_(point),
        mirrored_(2.0f * point.normal.dot(to_viewer) * point.normal - to_viewer),
        glossy_share_(share(point)) {}

  struct Draw {
    Eigen::Vector3f direction;
    Eigen::Array3f weight;  // reflectance × cosine ∕ density
  };
  /// Nothing where the direction goes into the surface, or where nothing is reflected.
  std::optional<Draw> draw(Rng& rng) const {
    const bool glossy = rng.uniform() < glossy_share_;
    const Eigen::Vector3f direction =
        (glossy ? draw_around(mirrored_, point_.exponent, rng) : draw_around(point_.normal, 1.0f, rng))
            .normalized();
    const float cosine = point_.normal.dot(direction);
    if (cosine <= 0.0f) return std::nullopt;
    const float power = std::pow(std::max(mirrored_.dot(direction), 0.0f), point_.exponent);
    const float lobe = (point_.exponent + 1.0f) / (2.0f * pi) * power;
    const float density = (1.0f - glossy_share_) * cosine / pi + glossy_share_ * lobe;
    const Eigen::Array3f reflectance =
        point_.diffuse / pi + point_.specular * (point_.exponent + 2.0f) / (2.0f * pi) * power;
    return Draw{direction, reflectance * cosine / density};
  }

 private:
  static float share(const SurfacePoint& point) {
    const float both = point.diffuse.sum() + point.specular.sum();
    return both > 0.0f ? point.specular.sum() / both : 0.0f;
  }

  const SurfacePoint& point_;
  Eigen::Vector3f mirrored_;
  float glossy_share_;
};

Eigen::Array3f trace(const Scene& scene, const MeshRays& rays, SurfacePoint point, Eigen::Vector3f to_viewer,
                     const PathLight& light, int reflections, Rng& rng) {
  Eigen::Array3f throughput = Eigen::Array3f::Ones();
  for (int k = 0; k < reflections; ++k) {
    const auto draw = Reflection(point, to_viewer).draw(rng);
    if (!draw) break;
    throughput *= draw->weight;
    const Eigen::Vector3f from = rays.off_surface(point.position, point.normal);
    const auto hit = rays.intersect(from, draw->direction);
    if (!hit) return throughput * light(point.position, draw->direction);
    if (!hit->front) break;
    point = point_of_hit(scene, *hit);
    to_viewer = -draw->direction;
  }
  return Eigen::Array3f::Zero();
}

}  // namespace

Eigen::Vector3f draw_around(const Eigen::Vector3f& axis, float exponent, Rng& rng) {
  const auto cosine = static_cast<float>(std::pow(rng.uniform(), 1.0 / (exponent + 1.0)));
  const float sine = std::sqrt(std::max(0.0f, 1.0f - cosine * cosine));
  const auto phi = static_cast<float>(rng.uniform(0.0, 2.0 * std::numbers::pi));
  const Eigen::Vector3f side = axis.unitOrthogonal();
  return sine * std::cos(phi) * side + sine * std::sin(phi) * axis.cross(side) + cosine * axis;
}

SurfacePoint point_of_vertex(const Scene& scene, std::size_t vertex) {
  const Material& material = scene.materials[scene.material_of_vertex[vertex]];
  return {scene.mesh.positions[vertex], scene.mesh.normals[vertex],
          material.diffuse * scene.mesh.colours[vertex], material.specular, material.exponent};
}

SurfacePoint point_of_hit(const Scene& scene, const MeshHit& hit) {
  const Mesh& mesh = scene.mesh;
  const Material& material = scene.material_of_triangle(hit.triangle);
  SurfacePoint point = {Eigen::Vector3f::Zero(), Eigen::Vector3f::Zero(), Eigen::Array3f::Zero(),
                        material.specular, material.exponent};
  for (std::size_t c = 0; c < 3; ++c) {
    const std::uint32_t corner = mesh.triangles[hit.triangle][c];
    point.position += hit.share[c] * mesh.positions[corner];
    point.normal += hit.share[c] * mesh.normals[corner];
    point.diffuse += hit.share[c] * mesh.colours[corner] * material.diffuse;
  }
  point.normal.normalize();
  return point;
}

std::vector<Eigen::Array3f> path_trace(const Scene& scene, const MeshRays& rays,
                                       std::span<const SurfacePoint> points,
                                       std::span<const Eigen::Vector3f> to_viewer, const PathLight& light,
                                       const PathOptions& options, const RunContext& run) {
  std::vector<Eigen::Array3f> radiance(points.size());
  Progress progress(run, "path tracing", points.size());
  tbb::parallel_for(std::size_t{0}, points.size(), [&](std::size_t k) {
    run.throw_if_stopped();
    Rng rng(options.seed, k);
    Eigen::Array3d sum = Eigen::Array3d::Zero();
    for (int path = 0; path < options.paths; ++path)
      sum += trace(scene, rays, points[k], to_viewer[k], light, options.reflections, rng).cast<double>();
    radiance[k] = (sum / options.paths).cast<float>();
    progress.advance();
  });
  return radiance;
}

}  // namespace refield::prt
