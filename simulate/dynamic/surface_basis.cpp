// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/surface_basis.h"

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <string>

#include "core/base/errors.h"
#include "core/base/linear_algebra.h"
#include "core/base/rng.h"
#include "core/base/run_context.h"
#include "simulate/dynamic/point_lights.h"

namespace refield::dynamic {

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
  if (functions.cols() < 1 || functions.rows() != areas.size())
    throw InputError("surface basis: " + std::to_string(functions.cols()) + " functions over " +
                     std::to_string(functions.rows()) + " vertices with " + std::to_string(areas.size()) +
                     " areas: give at least one function, and an area for each vertex");
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

void check(int functions, const PrincipalOptions& options) {
  const auto require = [](bool good, const std::string& what) {
    if (!good) throw InputError("principal basis: " + what);
  };
  require(functions >= 1, std::to_string(functions) + " functions: give at least 1");
  require(options.lights >= 1, std::to_string(options.lights) + " lights: give at least 1");
  require(!options.distances.empty(), "no distances: give at least one");
  for (const float distance : options.distances)
    require(distance > 1.0f, "distance " + std::to_string(distance) + ": give more than 1, in radii");
}

}  // namespace

SurfaceBasis principal_basis(const Mesh& mesh, const prt::MeshRays& rays, const BrdfFactors& factors,
                             int functions, const PrincipalOptions& options, const RunContext& run) {
  check(functions, options);
  if (factors.terms() == 0) throw InputError("principal basis: the surface is black; it needs none");
  const auto lights = point_lights(mesh, options.lights, options.distances);
  const Eigen::MatrixXf patterns =
      patterns_of(light_terms(mesh, rays, factors, lights, run), factors.terms());
  const Eigen::VectorXf areas = vertex_areas(mesh);
  const Eigen::MatrixXf components = principal_components(patterns, areas.cwiseSqrt(), functions);
  if (components.cols() == 0)
    throw InputError("principal basis: no light reaches the mesh; its triangles may face inwards");
  return surface_basis(components, areas);
}

}  // namespace refield::dynamic
