// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/object_transport.h"

#include <tbb/parallel_for.h>

#include "core/base/linear_algebra.h"
#include "core/base/rng.h"
#include "simulate/dynamic/brdf.h"
#include "simulate/dynamic/dynamic_scene.h"
#include "simulate/prt/transfer_samples.h"

namespace refield::dynamic {

namespace {

constexpr float flat_cosine = 0.9999f, flat_share = 1e-4f;

/// Evenly over a square of 2×2 about the origin, [count].
std::vector<Eigen::Vector2f> square_points(int count) {
  const int side = std::max(1, static_cast<int>(std::lround(std::sqrt(count))));
  std::vector<Eigen::Vector2f> points;
  for (int j = 0; j < side; ++j)
    for (int i = 0; i < side; ++i)
      points.push_back(
          Eigen::Vector2f(static_cast<float>(2 * i + 1 - side), static_cast<float>(2 * j + 1 - side)) /
          static_cast<float>(side));
  return points;
}

/// Vertices that face a light, up to a packet of them, on their way to be asked for.
class Facing {
 public:
  Facing(const Mesh& mesh, const prt::MeshRays& rays, const BrdfFactors& factors,
         const Eigen::Vector3f& light, float* terms)
      : mesh_(mesh),
        rays_(rays),
        factors_(factors),
        light_(light),
        terms_(terms),
        h_(static_cast<std::size_t>(factors.terms())) {}

  void add(std::size_t vertex) {
    const Eigen::Vector3f way = light_ - mesh_.positions[vertex];
    if (way.dot(mesh_.normals[vertex]) <= 0.0f) return;
    from_[count_] = rays_.off_surface(mesh_.positions[vertex], mesh_.normals[vertex]);
    distance_[count_] = way.norm();
    towards_[count_] = way / distance_[count_];
    vertex_[count_++] = vertex;
    if (count_ == prt::MeshRays::packet) flush();
  }

  void flush() {
    const std::uint32_t seen =
        rays_.unoccluded(std::span(from_).first(count_), std::span(towards_).first(count_),
                         std::span(distance_).first(count_));
    for (std::size_t i = 0; i < count_; ++i) {
      if ((seen >> i & 1u) == 0) continue;
      const Eigen::Vector3f local = tangent_frame(mesh_.normals[vertex_[i]]) * towards_[i];
      factors_.incoming(local, h_);
      const float irradiance = local.z() / (distance_[i] * distance_[i]);
      for (std::size_t k = 0; k < h_.size(); ++k) terms_[vertex_[i] * h_.size() + k] = h_[k] * irradiance;
    }
    count_ = 0;
  }

 private:
  const Mesh& mesh_;
  const prt::MeshRays& rays_;
  const BrdfFactors& factors_;
  const Eigen::Vector3f light_;
  float* terms_;
  std::vector<float> h_;
  std::array<Eigen::Vector3f, prt::MeshRays::packet> from_, towards_;
  std::array<float, prt::MeshRays::packet> distance_{};
  std::array<std::size_t, prt::MeshRays::packet> vertex_{};
  std::size_t count_ = 0;
};

}  // namespace

std::optional<Eigen::Vector3f> facing_of(const Mesh& mesh) {
  if (mesh.empty()) return std::nullopt;
  const Eigen::Vector3f facing = mesh.normals.front();
  const BoundingBall ball = bounding_ball(mesh);
  for (std::size_t v = 0; v < mesh.positions.size(); ++v)
    if (mesh.normals[v].dot(facing) < flat_cosine ||
        std::abs((mesh.positions[v] - ball.middle).dot(facing)) > flat_share * ball.radius)
      return std::nullopt;
  return facing;
}

std::vector<Eigen::Vector3f> point_lights(const Mesh& mesh, int count, std::span<const float> distances) {
  const BoundingBall ball = bounding_ball(mesh);
  const auto facing = facing_of(mesh);
  std::vector<Eigen::Vector3f> lights;
  for (const float distance : distances) {
    if (facing) {
      const Eigen::Matrix3f frame = tangent_frame(*facing);
      for (const Eigen::Vector2f& point : square_points(count))
        lights.push_back(ball.middle +
                         ball.radius *
                             (frame.transpose() * Eigen::Vector3f(point.x(), point.y(), distance - 1.0f)));
    } else {
      for (const auto& direction : prt::hammersley_sphere(count))
        lights.push_back(ball.middle + distance * ball.radius * direction.cast<float>());
    }
  }
  return lights;
}

Eigen::MatrixXf light_terms(const Mesh& mesh, const prt::MeshRays& rays, const BrdfFactors& factors,
                            std::span<const Eigen::Vector3f> lights, const RunContext& run) {
  const std::size_t rows = mesh.positions.size() * static_cast<std::size_t>(factors.terms());
  Eigen::MatrixXf terms =
      Eigen::MatrixXf::Zero(static_cast<Eigen::Index>(rows), static_cast<Eigen::Index>(lights.size()));
  Progress progress(run, "light on a surface", lights.size());
  tbb::parallel_for(std::size_t{0}, lights.size(), [&](std::size_t l) {
    run.throw_if_stopped();
    Facing facing(mesh, rays, factors, lights[l], terms.col(static_cast<Eigen::Index>(l)).data());
    for (std::size_t v = 0; v < mesh.positions.size(); ++v) facing.add(v);
    facing.flush();
    progress.advance();
  });
  return terms;
}

namespace {

/// One function after another, less what those before it have of it, twice for rounding (Gram and Schmidt).
Eigen::MatrixXd orthonormal(const Eigen::MatrixXd& functions, const Eigen::VectorXd& areas) {
  constexpr double smallest_share = 1e-3;
  Eigen::MatrixXd result(functions.rows(), functions.cols());
  Eigen::Index kept = 0;
  for (const auto& function : functions.colwise()) {
    Eigen::VectorXd rest = function;
    for (int pass = 0; pass < 2; ++pass)
      rest -= result.leftCols(kept) * (result.leftCols(kept).transpose() * areas.cwiseProduct(rest));
    const auto norm = [&areas](const auto& values) { return std::sqrt(areas.dot(values.cwiseAbs2())); };
    if (norm(rest) > smallest_share * norm(function)) result.col(kept++) = rest / norm(rest);
  }
  return result.leftCols(kept);
}

}  // namespace

SurfaceBasis surface_basis(const Eigen::MatrixXf& functions, const Eigen::VectorXf& areas) {
  SurfaceBasis basis;
  basis.functions = orthonormal(functions.cast<double>(), areas.cast<double>()).cast<float>();
  basis.to_weights = basis.functions.transpose() * areas.asDiagonal();
  return basis;
}

namespace {

/// L_k [vertices × lights · terms], each light brought to norm 1: it counts by its pattern, not by how near
/// it is.
Eigen::MatrixXf patterns_of(Eigen::MatrixXf light, Eigen::Index terms) {
  for (auto column : light.colwise())
    if (const float norm = column.norm(); norm > 0.0f) column /= norm;
  const Eigen::Index vertices = light.rows() / terms;
  Eigen::MatrixXf patterns(vertices, light.cols() * terms);
  for (Eigen::Index l = 0; l < light.cols(); ++l)
    patterns.middleCols(l * terms, terms) =
        Eigen::Map<const Eigen::MatrixXf>(light.col(l).data(), terms, vertices).transpose();
  return patterns;
}

Eigen::MatrixXf orthonormal_columns(const Eigen::MatrixXf& matrix) {
  return orthonormal_basis(matrix.cast<double>()).cast<float>();
}

/// Spans the first left singular vectors of root · patterns, [vertices × columns].
Eigen::MatrixXf range_of(const Eigen::MatrixXf& patterns, const Eigen::VectorXf& root, Eigen::Index columns) {
  constexpr int passes = 4;  // singular values of light fall slowly: some passes part them well
  Rng rng(1);
  Eigen::MatrixXf range =
      (root.asDiagonal() * patterns * Eigen::MatrixXf::NullaryExpr(patterns.cols(), columns, [&] {
         return static_cast<float>(rng.normal());
       })).eval();
  for (int pass = 0; pass < passes; ++pass) {
    range = orthonormal_columns(range);
    const Eigen::MatrixXf back = patterns.transpose() * (root.asDiagonal() * range);
    range = root.asDiagonal() * (patterns * back);
  }
  return orthonormal_columns(range);
}

/// [vertices × at most `count`], orthonormal under the areas root².
Eigen::MatrixXf principal_components(const Eigen::MatrixXf& patterns, const Eigen::VectorXf& root,
                                     Eigen::Index count) {
  constexpr Eigen::Index spare = 16;
  const Eigen::Index columns = std::min({count + spare, patterns.rows(), patterns.cols()});
  const Eigen::MatrixXf range = range_of(patterns, root, columns);
  const Eigen::MatrixXd shares = (range.transpose() * root.asDiagonal() * patterns).cast<double>();
  const SymmetricEigen solver = symmetric_eigen(shares * shares.transpose());
  const Eigen::VectorXd energy = solver.values.reverse();
  constexpr double min_value = 1e-10;  // what float cannot tell from zero is no pattern
  const Eigen::Index kept =
      std::min<Eigen::Index>(count, (energy.array() > std::max(min_value * energy[0], 0.0)).count());
  // X Xᵀ W Ψ = Ψ σ²: defined at vertices without area, too.
  const Eigen::MatrixXd vectors = solver.vectors.rowwise().reverse().leftCols(kept);
  const Eigen::MatrixXf mix =
      (shares.transpose() * vectors * energy.head(kept).cwiseInverse().asDiagonal()).cast<float>();
  return patterns * mix;
}

}  // namespace

SurfaceBasis principal_basis(const Mesh& mesh, const prt::MeshRays& rays, const BrdfFactors& factors,
                             int functions, const PrincipalOptions& options, const RunContext& run) {
  if (factors.terms() == 0) throw InputError("principal basis: the surface is black; it needs none");
  const auto lights = point_lights(mesh, options.lights, options.distances);
  const Eigen::MatrixXf patterns =
      patterns_of(light_terms(mesh, rays, factors, lights, run), factors.terms());
  const std::vector<float> area = prt::vertex_areas(mesh.positions, mesh.triangles);
  const Eigen::Map<const Eigen::VectorXf> areas(area.data(), static_cast<Eigen::Index>(area.size()));
  const Eigen::MatrixXf components = principal_components(patterns, areas.cwiseSqrt(), functions);
  if (components.cols() == 0)
    throw InputError("principal basis: no light reaches the mesh; its triangles may face inwards");
  return surface_basis(components, areas);
}

}  // namespace refield::dynamic
