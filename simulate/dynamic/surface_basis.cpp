// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/surface_basis.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <string>

#include "core/errors.h"

namespace refield::dynamic {

namespace {

/// Eigenvalues below so much of the largest are double's rounding.
constexpr double singular = 1e-15;

double condition_of(const Eigen::MatrixXd& a) {
  const Eigen::VectorXd values =
      Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(a, Eigen::EigenvaluesOnly).eigenvalues();
  const double largest = values[values.size() - 1], smallest = values[0];
  return smallest > singular * largest ? largest / smallest : std::numeric_limits<double>::infinity();
}

Eigen::MatrixXf inverse_of(const Eigen::MatrixXf& a, double condition) {
  Eigen::MatrixXf inverse = a.inverse();
  if (!inverse.allFinite())
    throw SolverError("The matrix of equation 7 has no inverse (condition " + std::to_string(condition) +
                      "): use fewer functions, or orthonormal weights");
  return inverse;
}

/// One function after another, less what those before it have of it, twice for rounding (Gram and Schmidt).
Eigen::MatrixXd orthonormal(const Eigen::MatrixXd& functions, const Eigen::VectorXd& areas,
                            double smallest_share) {
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

SurfaceBasis surface_basis(const Eigen::MatrixXf& functions, const Eigen::VectorXf& areas,
                           const BasisOptions& options) {
  if (functions.cols() < 1 || functions.rows() != areas.size())
    throw InputError("surface basis: " + std::to_string(functions.cols()) + " functions over " +
                     std::to_string(functions.rows()) + " vertices with " + std::to_string(areas.size()) +
                     " areas: give at least one function, and an area for each vertex");
  const Eigen::MatrixXd exact = functions.cast<double>();
  SurfaceBasis basis;
  basis.condition = condition_of(exact.transpose() * exact);
  if (options.weights == Weights::inverse) {
    basis.functions = functions;
    basis.to_weights = inverse_of(functions.transpose() * functions, basis.condition) * functions.transpose();
    return basis;
  }
  basis.functions = orthonormal(exact, areas.cast<double>(), options.smallest_share).cast<float>();
  basis.to_weights = basis.functions.transpose() * areas.asDiagonal();
  return basis;
}

}  // namespace refield::dynamic
