// SPDX-License-Identifier: Apache-2.0
#include "core/light/harmonics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "bench/studies/prt/harmonic_window.h"
#include "core/light/cube_map.h"
#include "core/light/monitor_placement.h"

namespace refield {
namespace {

TEST(CubeMap, SolidAnglesAddUpToTheSphereAndCentresAreWhereLightMapsSay) {
  constexpr int resolution = 33;
  double sphere = 0.0;
  for (int y = 0; y < cube_faces * resolution; ++y)
    for (int x = 0; x < resolution; ++x) sphere += cube_solid_angle(x, y, resolution);
  EXPECT_NEAR(sphere, 4.0 * std::numbers::pi, 1e-12);
  for (int face = 0; face < cube_faces; ++face) {
    const Eigen::Vector3d ahead = cube_face_axes(face).row(2);
    EXPECT_LT((cube_direction(16.5, face * resolution + 16.5, resolution) - ahead).norm(), 1e-12);
  }
}

TEST(CubeMap, PositionsAreFoundAgainFromTheirDirections) {
  constexpr int resolution = 7;
  for (double row = 0.0; row < cube_faces * resolution; row += 0.25)
    for (const double column : {0.1, 3.5, 5.75, 6.9}) {
      if (row == std::floor(row / resolution) * resolution) continue;  // an edge, which two faces share
      const Eigen::Vector2d found = cube_position(3.0 * cube_direction(column, row, resolution), resolution);
      EXPECT_LT((found - Eigen::Vector2d(column, row)).norm(), 1e-12);
    }
}

TEST(Harmonics, AreOrthonormal) {
  constexpr int order = 8, resolution = 64;
  constexpr int count = harmonics_of(order);
  Eigen::MatrixXd gram = Eigen::MatrixXd::Zero(count, count);
  Eigen::VectorXd y(count);
  for (int row = 0; row < cube_faces * resolution; ++row)
    for (int column = 0; column < resolution; ++column) {
      evaluate_harmonics(order, cube_direction(column + 0.5, row + 0.5, resolution), {y.data(), count});
      gram += cube_solid_angle(column, row, resolution) * y * y.transpose();
    }
  // Midpoints of texels integrate products of degree 14 to about (degree / resolution)².
  EXPECT_LT((gram - Eigen::MatrixXd::Identity(count, count)).cwiseAbs().maxCoeff(), 4e-3);
}

TEST(Harmonics, AreTheFunctionsOfThePapersTable) {
  const Eigen::Vector3d d = Eigen::Vector3d(0.3, -0.5, 0.7).normalized();
  const double x = d.x(), y = d.y(), z = d.z(), pi = std::numbers::pi;
  double values[25];
  evaluate_harmonics(5, d, values);
  EXPECT_NEAR(values[0], std::sqrt(1 / (4 * pi)), 1e-14);
  EXPECT_NEAR(values[1], std::sqrt(3 / (4 * pi)) * y, 1e-14);
  EXPECT_NEAR(values[2], std::sqrt(3 / (4 * pi)) * z, 1e-14);
  EXPECT_NEAR(values[3], std::sqrt(3 / (4 * pi)) * x, 1e-14);
  EXPECT_NEAR(values[5], std::sqrt(15 / (4 * pi)) * y * z, 1e-14);
  EXPECT_NEAR(values[6], std::sqrt(5 / (16 * pi)) * (3 * z * z - 1), 1e-14);
  EXPECT_NEAR(values[9], std::sqrt(35 / (32 * pi)) * (3 * x * x * y - y * y * y), 1e-14);
  EXPECT_NEAR(values[23], std::sqrt(315 / (32 * pi)) * z * (x * x * x - 3 * x * y * y), 1e-14);
  EXPECT_NEAR(values[20], std::sqrt(9 / (256 * pi)) * (35 * z * z * z * z - 30 * z * z + 3), 1e-14);
}

TEST(Harmonics, ManyAtOnceAreThoseOfEach) {
  constexpr int order = 8, directions = 21;
  Eigen::Matrix3Xf all(3, directions);
  for (int k = 0; k < directions; ++k)
    all.col(k) = Eigen::Vector3f(std::sin(2.0f * k), std::cos(5.0f * k), 0.1f * k - 1.0f).normalized();
  Eigen::MatrixXf together(harmonics_of(order), directions);
  evaluate_harmonics(order, all, together);
  Eigen::VectorXd one(harmonics_of(order));
  for (int k = 0; k < directions; ++k) {
    evaluate_harmonics(order, all.col(k).cast<double>(), {one.data(), static_cast<std::size_t>(one.size())});
    EXPECT_LT((together.col(k).cast<double>() - one).cwiseAbs().maxCoeff(), 1e-5);
  }
}

TEST(Harmonics, TurningCoefficientsTurnsTheFunction) {
  constexpr int order = largest_harmonics_order, count = harmonics_of(order);
  const Eigen::Matrix3d rotation = rotation_of(EulerAngles{.yaw = 34.0, .pitch = -71.0, .roll = 200.0});
  const Eigen::MatrixXd matrix = harmonic_rotation(order, rotation);
  const Eigen::VectorXd coefficients = Eigen::VectorXd::LinSpaced(count, -1.0, 2.0);
  const Eigen::VectorXd turned = matrix * coefficients;
  Eigen::VectorXd here(count), there(count);
  for (int k = 0; k < 50; ++k) {
    const Eigen::Vector3d direction =
        Eigen::Vector3d(std::cos(3.0 * k), std::sin(2.0 * k), std::cos(0.5 * k)).normalized();
    evaluate_harmonics(order, direction, {here.data(), count});
    evaluate_harmonics(order, rotation.transpose() * direction, {there.data(), count});
    EXPECT_NEAR(turned.dot(here), coefficients.dot(there), 1e-11);
  }
  EXPECT_LT((matrix * matrix.transpose() - Eigen::MatrixXd::Identity(count, count)).cwiseAbs().maxCoeff(),
            1e-12);
}

TEST(Harmonics, ASmallBrightLightRingsAndWindowsDampIt) {
  constexpr int order = 5, count = harmonics_of(order);
  const Eigen::Vector3d light = Eigen::Vector3d(1.0, 2.0, -0.5).normalized();
  Eigen::VectorXd towards(count), here(count);
  evaluate_harmonics(order, light, {towards.data(), count});
  const auto lowest_share = [&](HarmonicWindow window) {
    const std::vector<double> factors = window_factors(window, order);
    const Eigen::VectorXd coefficients =
        towards.cwiseProduct(Eigen::Map<const Eigen::VectorXd>(factors.data(), count));
    double lowest = 0.0;
    for (int y = 0; y < 6 * 16; ++y)
      for (int x = 0; x < 16; ++x) {
        evaluate_harmonics(order, cube_direction(x + 0.5, y + 0.5, 16), {here.data(), count});
        lowest = std::min(lowest, coefficients.dot(here));
      }
    return lowest / coefficients.dot(towards);
  };
  EXPECT_LT(lowest_share(HarmonicWindow::none), -0.12);
  EXPECT_GT(lowest_share(HarmonicWindow::lanczos), -0.07);
  EXPECT_GT(lowest_share(HarmonicWindow::hann), -0.05);
}

}  // namespace
}  // namespace refield
