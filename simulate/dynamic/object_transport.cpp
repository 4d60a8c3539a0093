// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/object_transport.h"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <span>

#include "core/errors.h"
#include "core/run_context.h"
#include "simulate/dynamic/point_lights.h"
#include "simulate/dynamic/tangent_frame.h"
#include "simulate/prt/hammersley.h"

namespace refield::dynamic {

namespace {

using Eigen::Index;

/// Directions of rays from one point, and the harmonics of each.
struct Rays {
  std::vector<Eigen::Vector3f> directions;
  Eigen::MatrixXf harmonics;  // [n² × directions]
  float solid_angle;          // of each
};

Rays rays_of(std::vector<Eigen::Vector3f> directions, float solid_angle, int order) {
  Rays rays{std::move(directions), {}, solid_angle};
  rays.harmonics.resize(harmonics_of(order), static_cast<Index>(rays.directions.size()));
  std::vector<double> values(static_cast<std::size_t>(harmonics_of(order)));
  for (std::size_t d = 0; d < rays.directions.size(); ++d) {
    evaluate_harmonics(order, rays.directions[d].cast<double>(), values);
    rays.harmonics.col(static_cast<Index>(d)) =
        Eigen::Map<const Eigen::VectorXd>(values.data(), rays.harmonics.rows()).cast<float>();
  }
  return rays;
}

Rays rays_all_around(int count, int order) {
  std::vector<Eigen::Vector3f> directions;
  for (const auto& direction : prt::hammersley_sphere(count)) directions.push_back(direction.cast<float>());
  return rays_of(std::move(directions), 4.0f * std::numbers::pi_v<float> / static_cast<float>(count), order);
}

/// Evenly over the cone in which a sphere around the origin is seen from a point outside of it.
/// `even_directions`: over the whole sphere.
Rays rays_towards(const Eigen::Vector3f& point, float radius,
                  std::span<const Eigen::Vector3d> even_directions, int order) {
  const float sine = std::min(radius / point.norm(), 1.0f);
  const float height = 1.0f - std::sqrt(std::max(1.0f - sine * sine, 0.0f));  // of the cap
  const Eigen::Matrix3f frame = tangent_frame(-point.normalized());
  std::vector<Eigen::Vector3f> directions;
  for (const auto& even : even_directions) {
    const float z = 1.0f - 0.5f * height * (1.0f - static_cast<float>(even.z()));
    const float across = std::sqrt(std::max(1.0f - z * z, 0.0f));
    const Eigen::Vector2f around = even.head<2>().normalized().cast<float>();
    directions.push_back(frame.transpose() * Eigen::Vector3f(across * around.x(), across * around.y(), z));
  }
  return rays_of(std::move(directions),
                 2.0f * std::numbers::pi_v<float> * height / static_cast<float>(even_directions.size()),
                 order);
}

/// How an object shines in each of its modes.
class Shine {
 public:
  Shine(const Mesh& mesh, const BrdfFactors& factors, const SurfaceModes& modes)
      : mesh_(mesh), factors_(factors), modes_(modes) {}

  Index columns() const { return 3 * modes_.count(); }

  /// Radiance from a point of the surface in a direction, [3 · modes], colours one after another. Corners of
  /// the triangle each shine in their own frame, and what leaves is interpolated: frames jump, light does
  /// not.
  void add_radiance(const prt::MeshHit& hit, const Eigen::Vector3f& direction,
                    Eigen::Ref<Eigen::VectorXf> sum, std::vector<Eigen::Array3f>& g) const {
    const auto terms = static_cast<std::size_t>(factors_.terms());
    const Index count = modes_.count();
    g.resize(terms);
    for (std::size_t corner = 0; corner < 3; ++corner) {
      const std::uint32_t vertex = mesh_.triangles[hit.triangle][corner];
      factors_.outgoing(tangent_frame(mesh_.normals[vertex]) * direction, g);
      for (std::size_t k = 0; k < terms; ++k) {
        const auto row = modes_.functions.row(static_cast<Index>(vertex * terms + k)).transpose();
        const Eigen::Array3f share = hit.share[corner] * mesh_.colours[vertex] * g[k];
        for (Index c = 0; c < 3; ++c) sum.segment(c * count, count) += share[c] * row;
      }
    }
  }

 private:
  const Mesh& mesh_;
  const BrdfFactors& factors_;
  const SurfaceModes& modes_;
};

/// The grid's points, of which those on an open sheet are moved a little to its front: on a sheet itself no
/// ray meets it.
std::vector<Eigen::Vector3f> grid_points(const ShellGrid& grid, const Mesh& mesh, float radius) {
  Eigen::Vector3f front = Eigen::Vector3f::Zero();
  float area = 0.0f;
  for (const auto& [a, b, c] : mesh.triangles) {
    const Eigen::Vector3f doubled =
        (mesh.positions[b] - mesh.positions[a]).cross(mesh.positions[c] - mesh.positions[a]);
    front += doubled;
    area += doubled.norm();
  }
  constexpr float step = 2e-3f;  // in radii; closed objects have no front: it adds up to nothing
  if (area > 0.0f) front *= step * radius / area;
  std::vector<Eigen::Vector3f> points;
  for (std::size_t p = 0; p < grid.points(); ++p) points.push_back(grid.position(p) + front);
  return points;
}

void trace_grid(const Mesh& mesh, const prt::MeshRays& rays, const TransportOptions& options,
                const Shine& shine, ObjectTransport& transport, const RunContext& run) {
  const std::vector<Eigen::Vector3f> points = grid_points(transport.grid, mesh, transport.radius);
  const Index count = harmonics_of(options.order);
  const Rays all_around = rays_all_around(options.directions, options.order);
  const std::vector<Eigen::Vector3d> even_directions = prt::hammersley_sphere(options.directions / 2);
  Eigen::MatrixXf radiance =
      Eigen::MatrixXf::Zero(shine.columns(), static_cast<Index>(points.size()) * count);
  transport.coverage = Eigen::MatrixXf::Zero(count, static_cast<Index>(points.size()));
  std::vector<char> outside(points.size(), 0);
  Progress progress(run, "light around objects", points.size());
  tbb::parallel_for(std::size_t{0}, points.size(), [&](std::size_t p) {
    run.throw_if_stopped();
    const bool near = points[p].norm() <= transport.radius * 1.0001f;
    const Rays cone =
        near ? Rays{} : rays_towards(points[p], transport.radius, even_directions, options.order);
    const Rays& towards = near ? all_around : cone;
    Eigen::MatrixXf seen(shine.columns(), static_cast<Index>(towards.directions.size()));
    Eigen::MatrixXf harmonics(count, seen.cols());
    std::vector<Eigen::Array3f> g;
    Index hits = 0, backs = 0;
    for (std::size_t d = 0; d < towards.directions.size(); ++d) {
      const auto hit = rays.intersect(points[p], towards.directions[d]);
      if (!hit) continue;
      const auto y = towards.harmonics.col(static_cast<Index>(d));
      transport.coverage.col(static_cast<Index>(p)) += towards.solid_angle * y;
      if (!hit->front) {
        ++backs;
        continue;
      }
      seen.col(hits).setZero();
      shine.add_radiance(*hit, -towards.directions[d], seen.col(hits), g);
      harmonics.col(hits++) = y;
    }
    outside[p] = backs <= hits;
    if (hits > 0 && outside[p])
      radiance.middleCols(static_cast<Index>(p) * count, count).noalias() =
          towards.solid_angle * seen.leftCols(hits) * harmonics.leftCols(hits).transpose();
    progress.advance();
  });
  transport.outside.assign(outside.begin(), outside.end());
  transport.leaving = low_rank(radiance, static_cast<int>(count), transport.modes.strength.replicate(3, 1),
                               options.compression);
}

void trace_vertices(const Mesh& mesh, const prt::MeshRays& rays, const TransportOptions& options,
                    const Shine& shine, ObjectTransport& transport, const RunContext& run) {
  const Rays all_around = rays_all_around(options.directions, options.order);
  const Index count = harmonics_of(options.order), terms = transport.terms();
  const auto vertices = static_cast<Index>(mesh.positions.size());
  transport.receiving = Eigen::MatrixXf::Zero(count, vertices * terms);
  Eigen::MatrixXf returning = Eigen::MatrixXf::Zero(shine.columns(), vertices * terms);
  Progress progress(run, "incident light of objects", mesh.positions.size());
  tbb::parallel_for(Index{0}, vertices, [&](Index v) {
    run.throw_if_stopped();
    const Eigen::Vector3f& normal = mesh.normals[static_cast<std::size_t>(v)];
    const Eigen::Vector3f from = rays.off_surface(mesh.positions[static_cast<std::size_t>(v)], normal);
    const Eigen::Matrix3f frame = tangent_frame(normal);
    std::vector<float> h(static_cast<std::size_t>(terms));
    std::vector<Eigen::Array3f> g;
    Eigen::VectorXf seen(shine.columns());
    for (std::size_t d = 0; d < all_around.directions.size(); ++d) {
      const Eigen::Vector3f local = frame * all_around.directions[d];
      if (local.z() <= 0.0f) continue;
      transport.factors.incoming(local, h);
      const Eigen::Map<const Eigen::RowVectorXf> taken(h.data(), terms);
      const float weight = local.z() * all_around.solid_angle;
      if (const auto hit = rays.intersect(from, all_around.directions[d])) {
        if (!hit->front) continue;
        seen.setZero();
        shine.add_radiance(*hit, -all_around.directions[d], seen, g);
        returning.middleCols(v * terms, terms).noalias() += weight * seen * taken;
      } else {
        transport.receiving.middleCols(v * terms, terms).noalias() +=
            weight * all_around.harmonics.col(static_cast<Index>(d)) * taken;
      }
    }
    progress.advance();
  });
  transport.returning = low_rank(returning, static_cast<int>(terms), transport.modes.strength.replicate(3, 1),
                                 options.compression);
}

}  // namespace

void TransportOptions::check() const {
  const auto require = [](bool good, const char* what) {
    if (!good) throw InputError(what);
  };
  require(order >= 2 && order <= 8, "order of harmonics: give 2 to 8");
  require(functions >= 1 && functions <= 256, "functions: give 1 to 256");
  require(rings >= 1 && rings <= 64 && shells >= 2 && shells <= 64, "rings: give 1 to 64; shells: 2 to 64");
  require(directions >= 16 && directions <= 1 << 20, "directions: give 16 to 1048576");
  require(compression >= 0.0 && compression < 1.0, "compression: give 0 to below 1");
  factors.check();
}

std::size_t ObjectTransport::bytes() const {
  const auto floats = static_cast<std::size_t>(modes.to_weights.size() + coverage.size() + receiving.size());
  return leaving.bytes() + returning.bytes() + floats * sizeof(float) + outside.size() / 8;
}

ShellGrid shell_grid_of(const TransportOptions& options, float radius) {
  return {options.rings, options.shells, options.smallest_radius * radius, options.largest_radius * radius};
}

ObjectTransport object_transport(const MovingObject& object, const prt::MeshRays& rays,
                                 const TransportOptions& options, const RunContext& run) {
  const ThreadLimit limit(run);
  options.check();
  ObjectTransport transport;
  transport.order = options.order;
  transport.factors = factor(object.brdf, options.factors, run);
  run.throw_if_stopped();
  transport.radius = bounding_ball(object.mesh).radius;
  transport.modes =
      options.modes == ModeKind::joint
          ? joint_modes(object.mesh, rays, transport.factors, options.functions, run)
          : separate_modes(principal_basis(object.mesh, rays, transport.factors, options.functions, {}, run),
                           transport.terms());
  run.throw_if_stopped();
  transport.grid = shell_grid_of(options, transport.radius);
  const Shine shine(object.mesh, transport.factors, transport.modes);
  trace_grid(object.mesh, rays, options, shine, transport, run);
  run.throw_if_stopped();
  trace_vertices(object.mesh, rays, options, shine, transport, run);
  transport.modes.functions.resize(0, 0);  // the largest part, needed for tracing alone
  return transport;
}

}  // namespace refield::dynamic
