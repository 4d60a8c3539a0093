// SPDX-License-Identifier: Apache-2.0
#include "tests/support/singular_values.h"

#include "core/base/linear_algebra.h"

namespace refield::test {

Eigen::VectorXd singular_values(const Eigen::MatrixXd& a) {
  const Eigen::MatrixXd gram =
      a.rows() < a.cols() ? Eigen::MatrixXd(a * a.transpose()) : Eigen::MatrixXd(a.transpose() * a);
  return symmetric_eigenvalues(gram).reverse().cwiseMax(0.0).cwiseSqrt();
}

}  // namespace refield::test
