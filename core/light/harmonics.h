// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <span>

namespace refield {

/// Real spherical harmonics of order n: the n² functions y_lm with l < n, |m| ≤ l, at index l(l + 1) + m.
/// Orthonormal over the sphere; y_11 grows along +X, y_1,−1 along +Y, y_10 along +Z, all without the
/// Condon–Shortley sign (Fujita and Kanai 2004, appendix A, table 3).
inline constexpr int largest_harmonics_order = 16;
constexpr int harmonics_of(int order) {
  return order * order;
}

/// `values` [order²] at a unit direction. By the recurrences for fully normalised Legendre functions, good
/// to rounding for any order allowed.
void evaluate_harmonics(int order, const Eigen::Vector3d& direction, std::span<double> values);
/// Evaluates many unit directions [3 × count] at once, `values` [order² × count], in single precision:
/// accurate to 1e-5.
void evaluate_harmonics(int order, const Eigen::Ref<const Eigen::Matrix3Xf>& directions,
                        Eigen::Ref<Eigen::MatrixXf> values);

/// The matrix [order² × order²] that takes the coefficients of a function f to those of the turned one,
/// g(ω) = f(R⁻¹ω), `rotation` being R. Bands do not mix. Each band's block is solved for from the values of
/// its functions in more directions than it has functions, all well spread: exact to rounding.
Eigen::MatrixXd harmonic_rotation(int order, const Eigen::Matrix3d& rotation);

}  // namespace refield
