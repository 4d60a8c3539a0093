// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>

namespace refield {

/// A = V diag(λ) Vᵀ.
struct SymmetricEigen {
  Eigen::VectorXd values;   ///< λ [n], ascending
  Eigen::MatrixXd vectors;  ///< V [n × n], orthonormal columns
};

/// Eigendecomposition of a symmetric matrix [n × n], of which only the lower triangle is read. It is Eigen's
/// SelfAdjointEigenSolver, compiled once: every unit that names that class takes seconds longer to compile.
SymmetricEigen symmetric_eigen(const Eigen::MatrixXd& matrix);

/// The eigenvalues [n] alone, ascending, which costs a fraction of the time.
Eigen::VectorXd symmetric_eigenvalues(const Eigen::MatrixXd& matrix);

}  // namespace refield
