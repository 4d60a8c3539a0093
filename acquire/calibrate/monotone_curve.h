// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

namespace refield {

/// The nearest values that never fall, by weighted least squares: pools what violates the order (Ayer et al.
/// 1955). `weights` as long as `values`, above 0, or empty for equal ones.
std::vector<double> never_falling(std::vector<double> values, std::vector<double> weights = {});

/// A curve through points that rises where they rise and is flat where they are flat, smooth otherwise:
/// piecewise cubic with the slopes of Fritsch and Butland 1984. Beyond the ends it goes on straight.
class MonotoneCurve {
 public:
  /// `x` strictly growing, at least two. Throws InputError otherwise.
  MonotoneCurve(std::vector<double> x, std::vector<double> y);
  double operator()(double x) const;
  double slope(double x) const;

 private:
  std::size_t interval(double x) const;
  std::vector<double> x_;
  std::vector<double> y_;
  std::vector<double> slope_;
};

}  // namespace refield
