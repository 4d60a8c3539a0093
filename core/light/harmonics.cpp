// SPDX-License-Identifier: Apache-2.0
#include "core/light/harmonics.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/base/linear_algebra.h"

namespace refield {

namespace {

/// Well spread over the sphere: a spiral by the golden angle.
Eigen::Vector3d spiral_direction(int k, int count) {
  const double z = 1.0 - (2.0 * k + 1.0) / count;
  const double phi = 2.0 * std::numbers::pi * (std::numbers::phi - 1.0) * k;
  const double radius = std::sqrt(1.0 - z * z);
  return {radius * std::cos(phi), radius * std::sin(phi), z};
}

/// The recurrences, for one direction or for many side by side; store(index, value).
template <class Number, class Value, class Store>
void recur(int order, const Value& x, const Value& y, const Value& z, const Store& store) {
  Number diagonal = static_cast<Number>(std::sqrt(0.25 / std::numbers::pi));  // P_mm without its (sin θ)^m
  Value cosine = Number(1) + Number(0) * x, sine = Number(0) * x;  // (sin θ)^m cos mφ and sin mφ
  for (int m = 0; m < order; ++m) {
    const auto scale = static_cast<Number>(m == 0 ? 1.0 : std::numbers::sqrt2);
    Value before = Number(0) * x, now = diagonal + before;
    for (int l = m; l < order; ++l) {
      const int middle = l * (l + 1);
      store(middle + m, Value(scale * cosine * now));
      if (m > 0) store(middle - m, Value(scale * sine * now));
      const double next = l + 1.0, mm = static_cast<double>(m) * m;
      const auto grow = static_cast<Number>(std::sqrt((4.0 * next * next - 1.0) / (next * next - mm)));
      const auto back = static_cast<Number>(
          l == m ? 0.0 : std::sqrt((l * static_cast<double>(l) - mm) / (4.0 * l * l - 1.0)));
      const Value after = grow * (z * now - back * before);
      before = now;
      now = after;
    }
    const Value turned = x * cosine - y * sine;
    sine = x * sine + y * cosine;
    cosine = turned;
    diagonal *= static_cast<Number>(std::sqrt((2.0 * m + 3.0) / (2.0 * m + 2.0)));
  }
}

}  // namespace

void evaluate_harmonics(int order, const Eigen::Vector3d& direction, std::span<double> values) {
  recur<double>(order, direction.x(), direction.y(), direction.z(),
                [&](int index, double value) { values[static_cast<std::size_t>(index)] = value; });
}

void evaluate_harmonics(int order, const Eigen::Ref<const Eigen::Matrix3Xf>& directions,
                        Eigen::Ref<Eigen::MatrixXf> values) {
  constexpr Eigen::Index block = 8;
  using Block = Eigen::Array<float, block, 1>;
  for (Eigen::Index first = 0; first < directions.cols(); first += block) {
    const Eigen::Index count = std::min(block, directions.cols() - first);
    Block x = Block::Zero(), y = Block::Zero(), z = Block::Ones();
    x.head(count) = directions.row(0).segment(first, count);
    y.head(count) = directions.row(1).segment(first, count);
    z.head(count) = directions.row(2).segment(first, count);
    recur<float>(order, x, y, z, [&](int index, const Block& value) {
      values.row(index).segment(first, count) = value.head(count);
    });
  }
}

Eigen::MatrixXd harmonic_rotation(int order, const Eigen::Matrix3d& rotation) {
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const int count = harmonics_of(order), directions = 2 * count;
  Rows values(directions, count), turned(directions, count);  // y_i(ω) and y_i(R⁻¹ω)
  for (int k = 0; k < directions; ++k) {
    const Eigen::Vector3d direction = spiral_direction(k, directions);
    evaluate_harmonics(order, direction, {values.row(k).data(), static_cast<std::size_t>(count)});
    evaluate_harmonics(order, rotation.transpose() * direction,
                       {turned.row(k).data(), static_cast<std::size_t>(count)});
  }
  Eigen::MatrixXd matrix = Eigen::MatrixXd::Zero(count, count);
  for (int band = 0; band < order; ++band) {
    const int first = band * band, size = 2 * band + 1;
    const Eigen::MatrixXd basis = values.middleCols(first, size);
    matrix.block(first, first, size, size) = solve_least_squares(basis, turned.middleCols(first, size));
  }
  return matrix;
}

}  // namespace refield
