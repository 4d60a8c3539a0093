// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>
#include <string>
#include <vector>

namespace refield {

/// Error of a field made from a share of its training images: relative RMSE of the middle pixel.
struct LearningPoint {
  float share = 0.0f;
  float error = 0.0f;
};

/// Error against the number of images, e² = noise² + scale / shareᶜ: what more images of the same kind would
/// do. The photographs' noise is known (`noise`, of the middle pixel); it is the floor that no number of
/// images gets below, and without it three points do not say where the curve will flatten.
class LearningCurve {
 public:
  /// Least squares of log(e² − noise²). Needs two points of different share; known() says whether there were.
  LearningCurve(std::span<const LearningPoint> points, double noise);

  bool known() const { return known_; }
  /// At `share` times the training images; 1 is the field itself.
  double error_at(double share) const;
  /// One sentence: whether twice the images would help.
  std::string advice() const;

 private:
  bool known_ = false;
  double floor_ = 0.0, scale_ = 0.0, exponent_ = 0.0;
};

}  // namespace refield
