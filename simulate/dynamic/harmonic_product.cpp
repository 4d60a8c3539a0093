// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/harmonic_product.h"

#include <Eigen/Core>
#include <cmath>
#include <numbers>

#include "core/harmonics.h"

namespace refield::dynamic {

namespace {

struct Node {
  double place, weight;
};

/// Gauss's nodes on [−1, 1]: roots of Legendre's polynomial by Newton's steps.
std::vector<Node> gauss_nodes(int count) {
  std::vector<Node> nodes;
  for (int i = 0; i < count; ++i) {
    double x = std::cos(std::numbers::pi * (i + 0.75) / (count + 0.5)), slope = 1.0;
    for (int step = 0; step < 50; ++step) {
      double before = 1.0, now = x;
      for (int l = 1; l < count; ++l) {
        const double after = ((2.0 * l + 1.0) * x * now - l * before) / (l + 1.0);
        before = now;
        now = after;
      }
      slope = count * (x * now - before) / (x * x - 1.0);
      const double change = now / slope;
      x -= change;
      if (std::abs(change) < 1e-15) break;
    }
    nodes.push_back({x, 2.0 / ((1.0 - x * x) * slope * slope)});
  }
  return nodes;
}

}  // namespace

HarmonicProduct::HarmonicProduct(int order) {
  const int count = harmonics_of(order);
  // Three factors below `order` each: exact from so many nodes and azimuths on.
  const int azimuths = 3 * order;
  Eigen::MatrixXd values(count, 2 * order * azimuths);
  Eigen::VectorXd weights(values.cols());
  Eigen::Index column = 0;
  for (const auto& [z, weight] : gauss_nodes(2 * order))
    for (int a = 0; a < azimuths; ++a, ++column) {
      const double phi = 2.0 * std::numbers::pi * a / azimuths, across = std::sqrt(1.0 - z * z);
      evaluate_harmonics(order, {across * std::cos(phi), across * std::sin(phi), z},
                         {values.col(column).data(), static_cast<std::size_t>(count)});
      weights[column] = weight * 2.0 * std::numbers::pi / azimuths;
    }
  first_.push_back(0);
  for (int i = 0; i < count; ++i) {
    for (int j = 0; j < count; ++j)
      for (int k = 0; k < count; ++k) {
        const double gamma =
            (values.row(i).array() * values.row(j).array() * values.row(k).array()).matrix() * weights;
        if (std::abs(gamma) < 1e-9) continue;
        pair_.push_back({static_cast<std::uint8_t>(j), static_cast<std::uint8_t>(k)});
        value_.push_back(static_cast<float>(gamma));
      }
    first_.push_back(static_cast<std::uint32_t>(value_.size()));
  }
}

Eigen::MatrixXf HarmonicProduct::matrix(std::span<const float> b) const {
  const auto count = static_cast<Eigen::Index>(first_.size() - 1);
  Eigen::MatrixXf matrix = Eigen::MatrixXf::Zero(count, count);
  for (Eigen::Index i = 0; i < count; ++i)
    for (std::uint32_t p = first_[static_cast<std::size_t>(i)]; p < first_[static_cast<std::size_t>(i) + 1];
         ++p)
      matrix(i, pair_[p].j) += value_[p] * b[pair_[p].k];
  return matrix;
}

}  // namespace refield::dynamic
