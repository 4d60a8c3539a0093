// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <span>
#include <vector>

namespace refield {

/// How a value that is measured once per photograph (the position of the camera, the room light) changes over
/// a capture: as few parameters as the measurements bear.
struct CapturePath {
  /// `line`: steady change; `jumps`: constant between a few sudden changes; `walk`: a random walk, smoothed.
  enum class Kind { rest, line, jumps, walk };
  Kind kind = Kind::rest;
  Eigen::MatrixXd values;  ///< [photographs × components], the first photograph's are 0
  std::vector<int> jumps;  ///< numbers of the first photographs after each jump, ascending
  double scatter = 0.0;    ///< weighted root mean square of the measurements about the path
};

/// Chooses the path of `measured` [measurements × components], taken of the photographs `at` (ascending, of
/// `photographs`), whose variances are those of `variance` [measurements] times an unknown factor, by the
/// Bayesian information criterion: a line has one parameter per component, a jump has its place and one per
/// component, a walk has its step (local level model, Kalman filter). `floor`: standard deviation below which
/// scatter explains nothing. Source: Schwarz 1978; Durbin and Koopman 2012, chapter 2.
CapturePath choose_path(const Eigen::MatrixXd& measured, const Eigen::VectorXd& variance,
                        std::span<const int> at, int photographs, double floor);

}  // namespace refield
