// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <functional>

namespace refield {

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
