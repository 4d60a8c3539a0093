// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>

namespace refield::test {

/// The singular values of a matrix, the largest first, good to 1e-8 of it: the least that any sum of that
/// many products must leave out (Eckart and Young 1936). By the eigenvalues of the smaller of AᵀA and AAᵀ,
/// since compiling Eigen's SVD takes half a minute.
Eigen::VectorXd singular_values(const Eigen::MatrixXd& a);

}  // namespace refield::test
