// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <functional>

/// Eigen's decompositions, compiled once: every unit that names one of them takes seconds longer to compile,
/// up to half a minute.
namespace refield {

/// A = V diag(λ) Vᵀ.
struct SymmetricEigen {
  Eigen::VectorXd values;   ///< λ [n], ascending
  Eigen::MatrixXd vectors;  ///< V [n × n], orthonormal columns
};

/// Eigendecomposition of a symmetric matrix [n × n], of which only the lower triangle is read.
SymmetricEigen symmetric_eigen(const Eigen::MatrixXd& matrix);

/// The eigenvalues [n] alone, ascending, which costs a fraction of the time.
Eigen::VectorXd symmetric_eigenvalues(const Eigen::MatrixXd& matrix);

/// A = U diag(σ) Vᵀ.
struct SingularValues {
  Eigen::VectorXd values;  ///< σ, descending
  Eigen::MatrixXd u, v;    ///< orthonormal columns; v [n × n] is whole, beyond the rank of A, too
};

/// Singular value decomposition of a small matrix [m × n], m ≥ n.
SingularValues singular_values(const Eigen::MatrixXd& matrix);

/// x of A x = b, A symmetric [n × n]; positive or negative semidefinite (LDLᵀ with pivots).
Eigen::VectorXd solve_symmetric(const Eigen::MatrixXd& matrix, const Eigen::VectorXd& right);

struct DefiniteSolution {
  Eigen::VectorXd x;
  double log_determinant = 0.0;  ///< of A
};

/// x of A x = b, A symmetric and positive definite, by Cholesky's factorisation; not finite for other A.
DefiniteSolution solve_definite(const Eigen::MatrixXd& matrix, const Eigen::VectorXd& right);

/// Least squares of A x = b by columns of b (QR with column pivots).
Eigen::MatrixXd solve_least_squares(const Eigen::MatrixXd& matrix, const Eigen::MatrixXd& right);

/// An orthonormal basis [m × n] of the columns of a matrix of full rank (QR).
Eigen::MatrixXd orthonormal_basis(const Eigen::MatrixXd& matrix);

/// A⁻¹ [n × n] (LU with partial pivots); not finite where A has none.
Eigen::MatrixXd inverse(const Eigen::MatrixXd& matrix);

struct LeastSquaresFit {
  Eigen::VectorXd parameters;
  Eigen::VectorXd residuals;
  Eigen::MatrixXd jacobian;  ///< [residuals × parameters]
};

/// Parameters of the least sum of squared residuals near `start`, by Levenberg's and Marquardt's method
/// (Eigen's port of MINPACK). `difference` × max(1, |parameter|): by which each parameter is changed for the
/// derivatives; must be large against the error of `residuals`, of which there are at least as many as
/// parameters. Ends where a step gains less than `gain` of the sum, at the latest after some hundred calls.
LeastSquaresFit least_squares(const std::function<Eigen::VectorXd(const Eigen::VectorXd&)>& residuals,
                              const Eigen::VectorXd& start, double difference, double gain);

}  // namespace refield
