// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/object_transport.h"

#include <tbb/parallel_for.h>

#include "core/base/linear_algebra.h"
#include "simulate/dynamic/brdf.h"
#include "simulate/dynamic/dynamic_scene.h"
#include "simulate/prt/transfer_samples.h"

namespace refield::dynamic {

ShellGrid::ShellGrid(int rings, int shells, float smallest, float largest) : rings_(rings) {
  log_smallest_ = std::log(smallest);
  log_step_ = shells > 1 ? std::log(largest / smallest) / static_cast<float>(shells - 1) : 1.0f;
  for (int s = 0; s < shells; ++s)
    radii_.push_back(std::exp(log_smallest_ + log_step_ * static_cast<float>(s)));
}

Eigen::Vector3f ShellGrid::position(std::size_t point) const {
  const std::size_t shell = point / (side() * side()), on_shell = point % (side() * side());
  const int u = static_cast<int>(on_shell % side()) - rings_,
            v = static_cast<int>(on_shell / side()) - rings_;
  const int y = rings_ - std::abs(u) - std::abs(v);
  // The lower half stands outside of the square's inner diamond, its x and z folded outwards.
  const int x = y >= 0 ? u : (u < 0 ? -1 : 1) * (rings_ - std::abs(v));
  const int z = y >= 0 ? v : (v < 0 ? -1 : 1) * (rings_ - std::abs(u));
  return radii_[shell] *
         Eigen::Vector3f(static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)).normalized();
}

std::uint32_t ShellGrid::number(int x, int y, int z) const {
  const int u = y >= 0 ? x : (x < 0 ? -1 : 1) * (rings_ - std::abs(z));
  const int v = y >= 0 ? z : (z < 0 ? -1 : 1) * (rings_ - std::abs(x));
  return static_cast<std::uint32_t>(static_cast<std::size_t>(v + rings_) * side() +
                                    static_cast<std::size_t>(u + rings_));
}

ShellGrid::Corners ShellGrid::around(const Eigen::Vector3f& place) const {
  const float radius = std::max(place.norm(), 1e-30f);
  const float shell_place = (std::log(radius) - log_smallest_) / log_step_;
  const int last = static_cast<int>(radii_.size()) - 1;
  const int inner = std::clamp(static_cast<int>(std::floor(shell_place)), 0, std::max(last - 1, 0));
  const int outer = std::min(inner + 1, last);
  const float outer_share = std::clamp(shell_place - static_cast<float>(inner), 0.0f, 1.0f);
  const float falloff = radius > radii_.back() ? radii_.back() * radii_.back() / (radius * radius) : 1.0f;

  // Within the octant: a + b + c = rings, whole parts and what is left of a and c.
  const Eigen::Array3f size = place.array().abs() / std::max(place.array().abs().sum(), 1e-30f);
  const float a = size.x() * static_cast<float>(rings_), c = size.z() * static_cast<float>(rings_);
  const int ia = std::min(static_cast<int>(a), rings_ - 1),
            ic = std::min(static_cast<int>(c), rings_ - 1 - ia);
  const float fa = a - static_cast<float>(ia), fc = c - static_cast<float>(ic);
  std::array<std::array<int, 2>, 3> corner;
  std::array<float, 3> share;
  if (fa + fc <= 1.0f || ia + ic + 2 > rings_) {
    corner = {{{ia, ic}, {ia + 1, ic}, {ia, ic + 1}}};
    share = {std::max(1.0f - fa - fc, 0.0f), fa, fc};
  } else {
    corner = {{{ia + 1, ic + 1}, {ia + 1, ic}, {ia, ic + 1}}};
    share = {fa + fc - 1.0f, 1.0f - fc, 1.0f - fa};
  }
  const int sx = place.x() < 0.0f ? -1 : 1, sy = place.y() < 0.0f ? -1 : 1, sz = place.z() < 0.0f ? -1 : 1;
  Corners corners;
  const auto on_shell = static_cast<std::uint32_t>(side() * side());
  for (std::size_t i = 0; i < 3; ++i) {
    const auto [x, z] = corner[i];
    const std::uint32_t point = number(sx * x, sy * std::max(rings_ - x - z, 0), sz * z);
    corners.point[i] = static_cast<std::uint32_t>(inner) * on_shell + point;
    corners.point[i + 3] = static_cast<std::uint32_t>(outer) * on_shell + point;
    corners.weight[i] = falloff * share[i] * (1.0f - outer_share);
    corners.weight[i + 3] = falloff * share[i] * outer_share;
  }
  return corners;
}

namespace {

constexpr float largest_whole = 32767.0f;

/// Σ columns · columnsᵀ, in double over pieces that float holds well.
Eigen::MatrixXd gram_of(const Eigen::MatrixXf& rows) {
  constexpr Eigen::Index piece = 4096;
  Eigen::MatrixXd gram = Eigen::MatrixXd::Zero(rows.rows(), rows.rows());
  for (Eigen::Index first = 0; first < rows.cols(); first += piece) {
    const auto part = rows.middleCols(first, std::min(piece, rows.cols() - first));
    gram += (part * part.transpose()).cast<double>();
  }
  return gram;
}

}  // namespace

ModeWeights LowRank::modes_of(const ModeWeights& weights) const {
  ModeWeights z(rank, 3);
  for (Eigen::Index c = 0; c < 3; ++c)
    z.col(c) = mix.middleCols(c * weights.rows(), weights.rows()) * weights.col(c);
  return z;
}

void LowRank::expand(std::size_t block, const ModeWeights& z, float* out) const {
  const std::int16_t* value = values.data() + block * static_cast<std::size_t>(rank * width);
  std::fill_n(out, 3 * width, 0.0f);
  float *red = out, *green = out + width, *blue = out + 2 * width;
  for (int r = 0; r < rank; ++r, value += width) {
    const float z0 = z(r, 0), z1 = z(r, 1), z2 = z(r, 2);
    for (int i = 0; i < width; ++i) {
      const auto u = static_cast<float>(value[i]);
      red[i] += z0 * u;
      green[i] += z1 * u;
      blue[i] += z2 * u;
    }
  }
  for (int i = 0; i < 3 * width; ++i) out[i] *= scale[block];
}

std::size_t LowRank::bytes() const {
  return values.size() * sizeof(std::int16_t) + scale.size() * sizeof(float) +
         static_cast<std::size_t>(mix.size()) * sizeof(float);
}

LowRank low_rank(const Eigen::MatrixXf& rows, int width) {
  LowRank result;
  result.width = width;
  result.blocks = static_cast<std::size_t>(rows.cols() / width);
  const SymmetricEigen solver = symmetric_eigen(gram_of(rows));
  const Eigen::VectorXd energy = solver.values.reverse().cwiseMax(0.0);  // the largest first
  // Float cannot tell less from nothing: an error of 3e-4.
  const double least = energy.sum() * 1e-7;
  double left = energy.sum();
  while (result.rank < energy.size() && left > least) left -= energy[result.rank++];
  // M ≈ (M V) Vᵀ
  const Eigen::MatrixXf to_modes =
      solver.vectors.rowwise().reverse().leftCols(result.rank).transpose().cast<float>();
  result.mix = to_modes;
  result.scale.assign(result.blocks, 0.0f);
  result.values.assign(result.blocks * static_cast<std::size_t>(width * result.rank), 0);
  if (result.rank == 0) return result;
  tbb::parallel_for(std::size_t{0}, result.blocks, [&](std::size_t block) {
    const Eigen::MatrixXf modes =
        to_modes * rows.middleCols(static_cast<Eigen::Index>(block) * width, width);  // [rank × width]
    const float largest = modes.cwiseAbs().maxCoeff();
    if (!(largest > 0.0f)) return;
    result.scale[block] = largest / largest_whole;
    std::int16_t* value = result.values.data() + block * static_cast<std::size_t>(result.rank * width);
    for (int r = 0; r < result.rank; ++r)
      for (int i = 0; i < width; ++i)
        *value++ = static_cast<std::int16_t>(std::lround(modes(r, i) / result.scale[block]));
  });
  return result;
}

SurfaceModes separate_modes(const SurfaceBasis& basis, int terms) {
  const Eigen::Index vertices = basis.functions.rows(), count = basis.functions.cols();
  SurfaceModes modes;
  modes.functions = SurfaceModes::Rows::Zero(vertices * terms, count * terms);
  modes.to_weights = Eigen::MatrixXf::Zero(count * terms, vertices * terms);
  for (Eigen::Index v = 0; v < vertices; ++v)
    for (int k = 0; k < terms; ++k) {
      modes.functions.row(v * terms + k).segment(k * count, count) = basis.functions.row(v);
      modes.to_weights.col(v * terms + k).segment(k * count, count) = basis.to_weights.col(v);
    }
  return modes;
}

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
  transport.leaving = low_rank(radiance, static_cast<int>(count));
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
  transport.returning = low_rank(returning, static_cast<int>(terms));
}

}  // namespace

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
  ObjectTransport transport;
  transport.order = options.order;
  transport.factors = factor(object.brdf, options.factors, run);
  run.throw_if_stopped();
  transport.radius = bounding_ball(object.mesh).radius;
  if (!options.fields) return transport;
  transport.modes = separate_modes(
      principal_basis(object.mesh, rays, transport.factors, options.functions, {}, run), transport.terms());
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
