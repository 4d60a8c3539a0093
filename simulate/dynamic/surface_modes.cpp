// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/surface_modes.h"

#include <Eigen/Eigenvalues>
#include <algorithm>

#include "simulate/dynamic/point_lights.h"

namespace refield::dynamic {

SurfaceModes separate_modes(const SurfaceBasis& basis, int terms) {
  const Eigen::Index vertices = basis.functions.rows(), count = basis.functions.cols();
  SurfaceModes modes;
  modes.functions = SurfaceModes::Rows::Zero(vertices * terms, count * terms);
  modes.to_weights = Eigen::MatrixXf::Zero(count * terms, vertices * terms);
  modes.strength = Eigen::VectorXf::Ones(count * terms);
  for (Eigen::Index v = 0; v < vertices; ++v)
    for (int k = 0; k < terms; ++k) {
      modes.functions.row(v * terms + k).segment(k * count, count) = basis.functions.row(v);
      modes.to_weights.col(v * terms + k).segment(k * count, count) = basis.to_weights.col(v);
    }
  return modes;
}

SurfaceModes joint_modes(const Mesh& mesh, const prt::MeshRays& rays, const BrdfFactors& factors, int modes,
                         const RunContext& run) {
  const PrincipalOptions standard;
  Eigen::MatrixXf light =
      light_terms(mesh, rays, factors, point_lights(mesh, standard.lights, standard.distances), run);
  // A light counts for its pattern, not for how near it is.
  for (Eigen::Index l = 0; l < light.cols(); ++l)
    if (const float norm = light.col(l).norm(); norm > 0.0f) light.col(l) /= norm;
  const int terms = factors.terms();
  const Eigen::VectorXf areas = vertex_areas(mesh);
  Eigen::VectorXf weight(light.rows());
  for (Eigen::Index row = 0; row < weight.size(); ++row) weight[row] = areas[row / terms];
  const Eigen::MatrixXf weighted = weight.cwiseSqrt().asDiagonal() * light;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(
      (weighted.transpose() * weighted).cast<double>());
  const Eigen::VectorXd energy = solver.eigenvalues().reverse().cwiseMax(0.0);
  // What float cannot tell from zero is no pattern.
  const Eigen::Index useful = (energy.array() > 1e-6 * energy[0]).count();
  const Eigen::Index count = std::min<Eigen::Index>(modes, useful);
  const Eigen::VectorXf sigma = energy.head(count).cwiseSqrt().cast<float>();
  const Eigen::MatrixXf vectors = solver.eigenvectors().rowwise().reverse().leftCols(count).cast<float>();
  SurfaceModes result;
  result.functions = light * vectors * sigma.cwiseInverse().asDiagonal();
  result.to_weights = result.functions.transpose() * weight.asDiagonal();
  result.strength = sigma;
  return result;
}

}  // namespace refield::dynamic
