// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/dynamic/fixed_basis.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include "core/base/errors.h"
#include "core/base/linear_algebra.h"
#include "core/light/harmonics.h"

namespace refield::dynamic {

namespace {

constexpr int max_functions = harmonics_of(largest_harmonics_order);

Eigen::MatrixXf harmonics(std::span<const SurfacePlace> places, int functions) {
  const int order = static_cast<int>(std::ceil(std::sqrt(functions)));
  std::vector<double> values(static_cast<std::size_t>(harmonics_of(order)));
  Eigen::MatrixXf result(places.size(), functions);
  for (std::size_t v = 0; v < places.size(); ++v) {
    evaluate_harmonics(order, places[v].sphere.cast<double>(), values);
    for (int i = 0; i < functions; ++i)
      result(static_cast<Eigen::Index>(v), i) = static_cast<float>(values[static_cast<std::size_t>(i)]);
  }
  return result;
}

/// Wavelet `index` (0: the mean) at a point of [0, 1]².
float wavelet(int index, const Eigen::Vector2f& point) {
  if (index == 0) return 1.0f;
  int level = 0, before = 1;  // squares along a side: 2^level; functions of coarser levels
  while (index >= 4 * before) {
    ++level;
    before *= 4;
  }
  const int side = 1 << level, kind = (index - before) / (side * side),
            square = (index - before) % (side * side);
  const auto half = [side](float coordinate, int place) {  // 0: outside of the square, else ±1
    const int twice = std::min(static_cast<int>(coordinate * static_cast<float>(2 * side)), 2 * side - 1);
    return twice / 2 != place ? 0.0f : (twice % 2 == 0 ? 1.0f : -1.0f);
  };
  const float x = half(point.x(), square % side), y = half(point.y(), square / side);
  const std::array<float, 3> details{x * std::abs(y), std::abs(x) * y, x * y};
  return static_cast<float>(side) * details[static_cast<std::size_t>(kind)];
}

/// Pairs (k, l), the lowest frequencies first.
std::vector<Eigen::Vector2i> frequencies(int count) {
  std::vector<Eigen::Vector2i> all;
  for (int k = 0; k < count; ++k)
    for (int l = 0; l < count; ++l) all.emplace_back(k, l);
  std::ranges::stable_sort(all, {}, [](const Eigen::Vector2i& f) { return f.squaredNorm(); });
  all.resize(static_cast<std::size_t>(count));
  return all;
}

Eigen::MatrixXf functions_of(BasisKind kind, std::span<const SurfacePlace> places, int functions) {
  if (kind == BasisKind::spherical_harmonics) return harmonics(places, functions);
  const std::vector<Eigen::Vector2i> waves = frequencies(functions);
  Eigen::MatrixXf result(places.size(), functions);
  for (std::size_t v = 0; v < places.size(); ++v)
    for (int i = 0; i < functions; ++i) {
      const Eigen::Vector2f& point = places[v].square;
      const Eigen::Array2f turns = std::numbers::pi_v<float> * point.array() *
                                   waves[static_cast<std::size_t>(i)].cast<float>().array();
      result(static_cast<Eigen::Index>(v), i) =
          kind == BasisKind::cosines ? turns.cos().prod() : wavelet(i, point);
    }
  return result;
}

}  // namespace

Eigen::MatrixXf fixed_functions(BasisKind kind, std::span<const SurfacePlace> places, int functions) {
  if (functions < 1 || functions > max_functions)
    throw InputError("surface basis of " + std::to_string(functions) +
                     " functions: give a number from 1 to " + std::to_string(max_functions));
  return functions_of(kind, places, functions);
}

SurfaceBasis fixed_basis(BasisKind kind, const Mesh& mesh, int functions) {
  return surface_basis(fixed_functions(kind, surface_places(mesh), functions), areas_of(mesh));
}

SurfaceBasis basis_by_inverse(const Eigen::MatrixXf& functions) {
  const Eigen::MatrixXf a = functions.transpose() * functions;
  const Eigen::MatrixXf inverted = inverse(a.cast<double>()).cast<float>();
  if (!inverted.allFinite())
    throw SolverError("The matrix of equation 7 has no inverse (condition " +
                      std::to_string(condition_of(functions)) +
                      "): use fewer functions, or orthonormal weights");
  return {functions, inverted * functions.transpose()};
}

double condition_of(const Eigen::MatrixXf& functions) {
  constexpr double singular = 1e-15;  // of the largest eigenvalue: below it is double's rounding
  const Eigen::MatrixXd exact = functions.cast<double>();
  const Eigen::VectorXd values = symmetric_eigenvalues(exact.transpose() * exact);
  const double largest = values[values.size() - 1], smallest = values[0];
  return smallest > singular * largest ? largest / smallest : std::numeric_limits<double>::infinity();
}

}  // namespace refield::dynamic
