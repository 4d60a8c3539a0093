// SPDX-License-Identifier: Apache-2.0
#include "tests/simulate/prt/harmonic_light.h"

#include <cmath>
#include <numbers>

#include "core/base/rng.h"

namespace refield::prt::test {

namespace {
Eigen::VectorXd harmonics_at(int order, const Eigen::Vector3d& direction) {
  Eigen::VectorXd values(harmonics_of(order));
  evaluate_harmonics(order, direction, {values.data(), static_cast<std::size_t>(values.size())});
  return values;
}
}  // namespace

Eigen::Array3f HarmonicLight::operator()(const Eigen::Vector3f& direction) const {
  return (coefficients.transpose() * harmonics_at(order, direction.cast<double>())).array().cast<float>();
}

HarmonicLight random_harmonic_light(int order, std::uint64_t seed) {
  Rng rng(seed);
  HarmonicLight light{order, Eigen::Matrix<double, Eigen::Dynamic, 3>::Zero(harmonics_of(order), 3)};
  for (int c = 0; c < 3; ++c) {
    for (int i = 1; i < harmonics_of(order); ++i) light.coefficients(i, c) = rng.normal();
    // |Σ c_i y_i| ≤ ‖c‖ ‖y‖, and Σ y_i² = order² ∕ 4π in every direction: bright sides, none below 0.
    light.coefficients(0, c) = 0.7 * light.coefficients.col(c).norm() * order;
  }
  return light;
}

Eigen::Array3f radiance(const HarmonicTransfer& transfer, const Scene& scene, const HarmonicLight& light,
                        std::size_t vertex, const Eigen::Vector3f& to_viewer) {
  const Eigen::Vector3f& normal = scene.mesh.normals[vertex];
  const Eigen::Vector3f mirrored = 2.0f * normal.dot(to_viewer) * normal - to_viewer;
  const Eigen::VectorXd over = transfer.outputs == 1 ? Eigen::VectorXd::Ones(1)
                                                     : harmonics_at(transfer.order, mirrored.cast<double>());
  Eigen::Array3d sum = Eigen::Array3d::Zero();
  const auto columns = static_cast<std::size_t>(harmonics_of(std::min(transfer.order, light.order)));
  for (int i = 0; i < transfer.outputs; ++i)
    for (int c = 0; c < 3; ++c)
      for (std::size_t j = 0; j < columns; ++j)
        sum[c] +=
            over[i] * transfer.row(vertex, i, c)[j] * light.coefficients(static_cast<Eigen::Index>(j), c);
  return sum.cast<float>() * transfer.colours[vertex];
}

HarmonicLight cap_light(const Eigen::Vector3f& middle, double half_angle, int order) {
  Eigen::VectorXd coefficients = harmonics_at(order, middle.cast<double>());
  const double edge = std::cos(half_angle);
  for (int l = 0; l < order; ++l) {
    const auto band = static_cast<unsigned>(l);
    // 2π ∫ P_l from the edge's height to 1.
    const double share =
        l == 0 ? 1.0 - edge : (std::legendre(band - 1, edge) - std::legendre(band + 1, edge)) / (2 * l + 1);
    coefficients.segment(l * l, 2 * l + 1) *= 2.0 * std::numbers::pi * share;
  }
  return {order, coefficients * Eigen::RowVector3d::Ones()};
}

}  // namespace refield::prt::test
