// SPDX-License-Identifier: Apache-2.0
#include "core/base/linear_algebra.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/QR>
#include <Eigen/SVD>
#include <unsupported/Eigen/NonLinearOptimization>

#include <algorithm>
#include <cmath>

namespace refield {

SymmetricEigen symmetric_eigen(const Eigen::MatrixXd& matrix) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(matrix);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

Eigen::VectorXd symmetric_eigenvalues(const Eigen::MatrixXd& matrix) {
  return Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(matrix, Eigen::EigenvaluesOnly).eigenvalues();
}

SingularValues singular_values(const Eigen::MatrixXd& matrix) {
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(matrix, Eigen::ComputeThinU | Eigen::ComputeFullV);
  return {svd.singularValues(), svd.matrixU(), svd.matrixV()};
}

Eigen::VectorXd solve_symmetric(const Eigen::MatrixXd& matrix, const Eigen::VectorXd& right) {
  return matrix.ldlt().solve(right);
}

DefiniteSolution solve_definite(const Eigen::MatrixXd& matrix, const Eigen::VectorXd& right) {
  const Eigen::LLT<Eigen::MatrixXd> factor(matrix);
  return {factor.solve(right), 2.0 * factor.matrixLLT().diagonal().array().log().sum()};
}

Eigen::MatrixXd solve_least_squares(const Eigen::MatrixXd& matrix, const Eigen::MatrixXd& right) {
  return matrix.colPivHouseholderQr().solve(right);
}

Eigen::MatrixXd orthonormal_basis(const Eigen::MatrixXd& matrix) {
  return Eigen::HouseholderQR<Eigen::MatrixXd>(matrix).householderQ() *
         Eigen::MatrixXd::Identity(matrix.rows(), matrix.cols());
}

Eigen::MatrixXd inverse(const Eigen::MatrixXd& matrix) {
  return matrix.inverse();
}

namespace {

/// What Eigen's solver asks for.
struct Problem {
  const std::function<Eigen::VectorXd(const Eigen::VectorXd&)>& residuals;
  double difference;
  Eigen::Index count;

  Eigen::Index values() const { return count; }
  int operator()(const Eigen::VectorXd& parameters, Eigen::VectorXd& result) const {
    result = residuals(parameters);
    return 0;
  }
  int df(const Eigen::VectorXd& parameters, Eigen::MatrixXd& jacobian) const {
    const Eigen::VectorXd here = residuals(parameters);
    for (Eigen::Index i = 0; i < parameters.size(); ++i) {
      Eigen::VectorXd changed = parameters;
      changed[i] += difference * std::max(1.0, std::abs(parameters[i]));
      jacobian.col(i) = (residuals(changed) - here) / (changed[i] - parameters[i]);
    }
    return 0;
  }
};

}  // namespace

LeastSquaresFit least_squares(const std::function<Eigen::VectorXd(const Eigen::VectorXd&)>& residuals,
                              const Eigen::VectorXd& start, double difference, double gain) {
  LeastSquaresFit fit;
  fit.parameters = start;
  fit.residuals = residuals(start);
  Problem problem{residuals, difference, fit.residuals.size()};
  Eigen::LevenbergMarquardt<Problem> solver(problem);
  solver.parameters.ftol = gain;
  solver.minimize(fit.parameters);
  fit.residuals = residuals(fit.parameters);
  fit.jacobian.resize(fit.residuals.size(), fit.parameters.size());
  problem.df(fit.parameters, fit.jacobian);
  return fit;
}

}  // namespace refield
